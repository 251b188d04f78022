"""The best photo for every face, and the textured model."""

from ..photos.view import View
from .colour.colour_chart import ColourChart, find_colour_chart
from .colour.correction import ColourCorrection, fit_correction
from .colour.levelling import SeamLevels, level_seams, level_seams_job
from .models.atlas import Atlas, bake_atlas, bake_atlas_job
from .models.deviation import Deviation, surface_deviation
from .models.obj import write_obj, write_obj_job
from .models.simplify import SimplifiedMesh, simplify_mesh, simplify_mesh_job
from .models.split import SplitMesh, split_large_faces, split_large_faces_job
from .select import select_views, select_views_job
from .selection import Selection

__all__ = [
    "Atlas",
    "ColourChart",
    "ColourCorrection",
    "Deviation",
    "SeamLevels",
    "Selection",
    "SimplifiedMesh",
    "SplitMesh",
    "View",
    "bake_atlas",
    "bake_atlas_job",
    "find_colour_chart",
    "fit_correction",
    "level_seams",
    "level_seams_job",
    "select_views",
    "select_views_job",
    "simplify_mesh",
    "simplify_mesh_job",
    "split_large_faces",
    "split_large_faces_job",
    "surface_deviation",
    "write_obj",
    "write_obj_job",
]
