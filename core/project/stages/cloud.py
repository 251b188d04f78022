"""A point cloud as the scan of a project: its points take their colours from the photos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...arrays import FloatArray
from ...errors import ProjectError, TextureError
from ...files import replacing
from ...jobs import Job, part
from ...photos.view import View
from ...scans.scan import Scan
from ...settings import TextureSettings
from ...texture.colour.correction import ColourCorrection
from ...texture.models.colours import Colours, PointSelection, select_views_for_points_job
from ..entries import Project
from .delivery import corrected_colours
from .refinement import RefineSettings
from .textures import settings_among


@dataclass(frozen=True, eq=False)
class ColouredCloud:
    """A point cloud with a photo for every point, local to the scan; `selection` refers to `views`."""

    points: FloatArray
    selection: PointSelection
    views: tuple[View, ...]

    @property
    def coverage(self) -> float:
        """Share of the points that have a photo, in 0..1."""
        return float(np.mean(self.selection.view >= 0))


def check_cloud(project: Project, scan: Scan) -> None:
    """Refuse what a point cloud cannot give, before anything is computed. Raises ProjectError."""
    wishes = {
        "refine": project.refine != RefineSettings(),
        "atlas": project.atlas is not None,
        "simplify": project.simplify is not None,
        "photo.telephoto": any(entry.telephoto for entry in project.photos),
        "regions.kept": project.regions.kept is not None,
    }
    for key, wished in wishes.items():
        if wished:
            reason = (
                f"needs the faces of a mesh, but {scan.name} is a point cloud; mesh it, or leave this out"
            )
            raise ProjectError(project.path, key, reason)


def colour_cloud_job(
    scan: Scan, views: Sequence[View], layers: Sequence[str], settings: TextureSettings
) -> Job[dict[str, ColouredCloud]]:
    """Choose a photo for every point of a cloud, for each set of photos by itself.

    `views` are in the scan's local coordinates; `layers` names the set of each. Raises
    TextureError, PhotoError.
    """
    if not views:
        raise TextureError("No photo has a pose: there is nothing to colour the points with.")
    names = list(dict.fromkeys(layers))
    found = {}
    for number, name in enumerate(names):
        numbers = [k for k, layer in enumerate(layers) if layer == name]
        chosen, own = [views[k] for k in numbers], settings_among(settings, numbers)
        job = select_views_for_points_job(scan.vertices, None, chosen, own, "hull")
        start, end = number / len(names), (number + 1) / len(names)
        selection: PointSelection = yield from part(job, start, end, f"{name}: " if name else "")
        found[name] = ColouredCloud(scan.vertices, selection, tuple(chosen))
    return found


def write_coloured_cloud(
    path: Path, cloud: ColouredCloud, offset: FloatArray, correction: ColourCorrection | None = None
) -> Path:
    """Write points, colours and the photo of each (`photo`, -1 for none) as PLY, in the world of the file."""
    colours: Colours = corrected_colours(cloud.selection.colours, correction)
    rows = np.zeros(len(cloud.points), dtype=[("xyz", "<f8", 3), ("rgb", "u1", 3), ("photo", "<i4")])
    rows["xyz"], rows["rgb"], rows["photo"] = cloud.points + offset, colours.rgb, cloud.selection.view
    lines = ["ply", "format binary_little_endian 1.0"]
    lines += [f"comment photo {number} {view.name}" for number, view in enumerate(cloud.views)]
    lines += [f"element vertex {len(rows)}", *(f"property double {axis}" for axis in "xyz")]
    lines += [f"property uchar {channel}" for channel in ("red", "green", "blue")]
    lines += ["property int photo", "end_header", ""]
    with replacing(path) as file:
        file.write("\n".join(lines).encode())
        file.write(rows.tobytes())
    return path
