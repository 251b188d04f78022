"""The best photo for every face, and the textured model."""

from ..photos.view import View
from .atlas import Atlas, bake_atlas, bake_atlas_job
from .levelling import SeamLevels, level_seams, level_seams_job
from .obj import write_obj, write_obj_job
from .select import select_views, select_views_job
from .selection import Selection
from .split import SplitMesh, split_large_faces, split_large_faces_job

__all__ = [
    "Atlas",
    "SeamLevels",
    "Selection",
    "SplitMesh",
    "View",
    "bake_atlas",
    "bake_atlas_job",
    "level_seams",
    "level_seams_job",
    "select_views",
    "select_views_job",
    "split_large_faces",
    "split_large_faces_job",
    "write_obj",
    "write_obj_job",
]
