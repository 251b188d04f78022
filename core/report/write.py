"""Writing the report: one HTML file that holds its pictures, to be mailed and archived as it is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arrays import ByteArray, FloatArray, IntArray
from ..files import replacing
from ..jobs import Job, Progress, drain, part
from ..project.run import ProjectResult
from ..project.stages.textures import TexturedScan
from ..texture.models.render import shade_clay, shade_faces, shade_textured_job, trace_pixels_job
from .content import Report, photo_rows, project_report
from .figures import draw_photo, jpeg
from .maps import FACE_MAPS, FaceMap
from .page import Figure, page
from .viewpoint import Viewpoint, facing, two_viewpoints

_PHOTO_WIDTH, _SMALL_PHOTO_WIDTH = 960, 600
_MANY_PHOTOS = 40
"""Above this many photos their pictures are smaller: the file stays below some 20 MB for 200 photos."""


@dataclass(frozen=True, eq=False)
class _FacesShown:
    """Photo and UVs of the faces that a picture shows; see `TexturedFaces`."""

    view: IntArray
    uv: FloatArray
    gain: FloatArray


@dataclass(frozen=True, eq=False)
class _Pictures:
    """Figures of the page, in its order."""

    photos: list[Figure]
    model: list[Figure]
    maps: list[Figure]
    layers: dict[str, list[Figure]]


def write_report_job(result: ProjectResult | Report, path: Path | str) -> Job[Path]:
    """Write the report of a run to one HTML file that needs nothing beside it; return its path.

    Raises PhotoError for a photo that cannot be read any more, OutputError when the file cannot be written.
    """
    report = result if isinstance(result, Report) else project_report(result)
    pictures = yield from part(_pictures_job(report), 0.0, 0.95)
    yield Progress(0.95, "Writing the report")
    text = page(report, photo_rows(report), pictures.photos, pictures.model, pictures.maps, pictures.layers)
    with replacing(path) as file:
        file.write(text.encode())
    return Path(path)


def write_report(result: ProjectResult | Report, path: Path | str) -> Path:
    """Run `write_report_job` to its end."""
    return drain(write_report_job(result, path))


def _pictures_job(report: Report) -> Job[_Pictures]:
    photos = []
    width = _PHOTO_WIDTH if len(report.photos) <= _MANY_PHOTOS else _SMALL_PHOTO_WIDTH
    for number, (photo, result) in enumerate(zip(report.photos, report.poses, strict=True)):
        yield Progress(0.4 * number / len(report.photos), f"Drawing the regions of {photo.name}")
        image = draw_photo(photo, result.pose, report.surfaces, width)
        photos.append(Figure(jpeg(image), image.shape[1], image.shape[0], photo.name))
    if report.textured is None:
        return _Pictures(photos, [], [], {})
    share = 0.6 / len(report.textures)
    model, maps = yield from part(_model_job(report.textured), 0.4, 0.4 + share)
    layers = {}
    for number, (name, textured) in enumerate(report.layers.items(), 1):
        start = 0.4 + share * number
        textures, own = yield from part(_model_job(textured), start, start + share, f"{name}: ")
        layers[name] = [*textures[1::2], *own]  # the plain scan is shown with the first texture
    return _Pictures(photos, model, maps, layers)


def _model_job(textured: TexturedScan) -> Job[tuple[list[Figure], list[Figure]]]:
    """Pictures of the plain and the textured model from two sides, and the maps from one of them."""
    used = textured.selection.view >= 0
    shown = textured.faces[used] if used.any() else textured.faces
    viewpoints = two_viewpoints(textured.vertices, shown, textured.views)
    found = [make(textured) for make in FACE_MAPS.values()]
    maps = [one for one in found if one is not None]
    # The maps are shown from the side that turns more of the textured surface to the viewer.
    seen = [len(facing(textured.vertices, shown, viewpoint)) for viewpoint in viewpoints]
    model: list[Figure] = []
    mapped: list[Figure] = []
    for number, viewpoint in enumerate(viewpoints):
        wanted = maps if number == int(np.argmax(seen)) else []
        pictures = yield from part(_side_job(textured, viewpoint, wanted), number / 2, (number + 1) / 2)
        model += pictures[:2]
        mapped += pictures[2:]
    return model, mapped


def _side_job(textured: TexturedScan, viewpoint: Viewpoint, wanted: list[FaceMap]) -> Job[list[Figure]]:
    """One side: the plain scan, the textured model, the wanted maps."""
    front = facing(textured.vertices, textured.faces, viewpoint)
    vertices, faces = textured.vertices, textured.faces[front]
    tracing = trace_pixels_job(viewpoint.camera, viewpoint.rotation, viewpoint.translation, vertices, faces)
    hits = yield from part(tracing, 0.0, 0.6, f"The model {viewpoint.name}: ")
    selection = textured.selection
    chosen = _FacesShown(selection.view[front], selection.uv[front], selection.gain)
    shading = shade_textured_job(hits, vertices, faces, chosen, textured.views)
    picture = yield from part(shading, 0.6, 0.9, f"The model {viewpoint.name}: ")
    images: list[tuple[ByteArray, str, FaceMap | None]] = [
        (shade_clay(hits, vertices, faces), f"The scan, {viewpoint.name}", None),
        (picture.image, f"Textured, {viewpoint.name}", None),
        *((shade_faces(hits, vertices, faces, m.colours[front]), m.title, m) for m in wanted),
    ]
    yield Progress(0.95, "Encoding pictures")
    return [Figure(jpeg(i), i.shape[1], i.shape[0], title, legend) for i, title, legend in images]
