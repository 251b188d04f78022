"""What a report says: the numbers of a run, gathered and not yet formatted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..arrays import BoolArray, Float32Array, FloatArray
from ..cameras.files.dictionary import camera_to_dict
from ..geometry.rigid import camera_centre, rotation_angle
from ..photos.photo import Photo
from ..project.run import ProjectResult
from ..project.stages.maps import median_over_area, texture_shift
from ..project.stages.photo_pose import PhotoPose, Refinement
from ..project.stages.textures import TexturedScan
from ..regions.surface_region import SurfaceRegion
from ..scans.scan import Scan


@dataclass(frozen=True, eq=False)
class Report:
    """All that a report shows. Coordinates are local to the scan: world = local + `scan.offset`.

    `poses` has one result per photo; `surfaces` are the scan's regions by name; `textured` is None when only
    poses were solved. `layers` has the textures of further sets of photos by their name, `made` sentences on
    what was made of them. `versions` and `seconds` are shown as they are. `truth` gives known poses by the
    photo's name, (rotation, translation) in world coordinates, where errors shall be shown.
    """

    title: str
    scan: Scan
    surfaces: Mapping[str, SurfaceRegion]
    photos: Sequence[Photo]
    poses: Sequence[PhotoPose]
    textured: TexturedScan | None = None
    written: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    truth: Mapping[str, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    layers: Mapping[str, TexturedScan] = field(default_factory=dict)
    made: Sequence[str] = ()

    @property
    def textures(self) -> list[TexturedScan]:
        """The texture and those of the further layers."""
        return [] if self.textured is None else [self.textured, *self.layers.values()]

    def texture_with(self, photo: str) -> TexturedScan | None:
        """Return the texture that a photo took part in, else the first one."""
        taking = (one for one in self.textures if any(view.name == photo for view in one.views))
        return next(taking, self.textured)


@dataclass(frozen=True)
class PhotoRow:
    """The numbers of one photo; None where there is nothing to say.

    `overlap_error` in percent, `rotation_sigma` and `rotation_error` in degrees, `centre_sigma` and
    `centre_error` in mm, `area` in m², `texel_size` (median over the surface that uses the photo) in mm,
    `shift` against the photos that see the same surface in pixels; `surface_shift` is the standard deviation
    in mm, median over that surface, that the pose's uncertainty causes there.
    """

    name: str
    camera: str
    body: str
    status: str
    regions: tuple[str, ...]
    notes: tuple[str, ...]
    failure: str = ""
    overlap_error: float | None = None
    rotation_sigma: float | None = None
    centre_sigma: float | None = None
    faces: int | None = None
    area: float | None = None
    texel_size: float | None = None
    shift: float | None = None
    rotation_error: float | None = None
    centre_error: float | None = None
    surface_shift: float | None = None
    refinements: tuple[Refinement, ...] = ()


def project_report(
    result: ProjectResult, truth: Mapping[str, tuple[FloatArray, FloatArray]] | None = None
) -> Report:
    """Return the report of a project's run; see `Report` for `truth`."""
    record = result.provenance
    versions = {key: value for key, value in record["versions"].items() if key != "code"}
    return Report(
        result.project.output.name,
        result.scan,
        result.surfaces,
        result.photos,
        result.poses,
        result.textured,
        record["written"],
        versions,
        result.seconds,
        truth or {},
        {name: one for name, one in result.layers.items() if one is not result.textured},
        _made(result),
    )


def _made(result: ProjectResult) -> list[str]:
    """Sentences on colour charts and simplified models."""
    return [
        *(f"Colour chart{_of(n)} in {chart.photo}: {chart.told}." for n, chart in result.charts.items()),
        *(f"Simplified model{_of(n)}: {model.told}." for n, model in result.simplified.items()),
    ]


def _of(layer: str) -> str:
    return f" of {layer}" if layer else ""


def photo_rows(report: Report) -> list[PhotoRow]:
    """Numbers of every photo, in the order of `report.photos`."""
    areas = np.zeros(0) if report.textured is None else face_areas(report.textured)  # all layers share a mesh
    shifts = {id(textured): texture_shift(textured) for textured in report.textures}
    rows = []
    for photo, result in zip(report.photos, report.poses, strict=True):
        textured = report.texture_with(photo.name)
        shift = np.zeros(0, dtype=np.float32) if textured is None else shifts[id(textured)]
        rows.append(_row(report, photo, result, textured, areas, shift))
    return rows


def _row(
    report: Report,
    photo: Photo,
    result: PhotoPose,
    textured: TexturedScan | None,
    areas: FloatArray,
    shifts: Float32Array,
) -> PhotoRow:
    pose, sure = result.pose, result.sure_pose
    used = faces_of_photo(textured, photo.name)
    rotation_error, centre_error = _errors(report, result)
    return PhotoRow(
        photo.name,
        describe_camera(photo),
        " ".join(text for text in (photo.exif.make, photo.exif.model) if text),
        "given" if result.given else "solved" if result.solved else "ambiguous" if pose else "failed",
        result.regions or tuple(mark.name for mark in photo.regions),
        tuple(filter(None, dict.fromkeys((photo.camera_source, *photo.notes, *result.notes)))),
        result.failure,
        result.overlap_error,
        None if sure is None else sure.rotation_sigma,
        None if sure is None else 1000 * sure.centre_sigma,
        None if used is None else int(used.sum()),
        None if used is None else float(areas[used].sum()),
        _texel_size(textured, used, areas),
        _shift(textured, photo.name),
        rotation_error,
        centre_error,
        None if used is None else _in_mm(median_over_area(shifts[used], areas[used])),
        result.refinements,
    )


def _in_mm(metres: float | None) -> float | None:
    return None if metres is None else 1000 * metres


def faces_of_photo(textured: TexturedScan | None, name: str) -> BoolArray | None:
    """Faces (F,) that use a photo; None when it did not take part in texturing."""
    if textured is None:
        return None
    numbers = [number for number, view in enumerate(textured.views) if view.name == name]
    return np.isin(textured.selection.view, numbers) if numbers else None


def _texel_size(textured: TexturedScan | None, used: BoolArray | None, areas: FloatArray) -> float | None:
    """Median over the area, in mm."""
    if textured is None or used is None or not used.any():
        return None
    return _in_mm(median_over_area(textured.selection.texel_size[used], areas[used]))


def _shift(textured: TexturedScan | None, name: str) -> float | None:
    """Median distance in pixels between where a photo shows details and where its neighbours do."""
    found = [] if textured is None else [n for n, view in enumerate(textured.views) if view.name == name]
    if textured is None or not found:
        return None
    return float(textured.selection.pose_shift[found[0]])


def _errors(report: Report, result: PhotoPose) -> tuple[float | None, float | None]:
    """Error against the known pose: degrees, mm."""
    pose = result.pose
    if pose is None or result.photo not in report.truth:
        return None, None
    rotation, translation = (np.asarray(part, dtype=np.float64) for part in report.truth[result.photo])
    true_centre = camera_centre(rotation, translation) - report.scan.offset
    angle = float(np.degrees(rotation_angle(pose.rotation @ rotation.T)))
    return angle, 1000 * float(np.linalg.norm(pose.centre - true_centre))


def face_areas(textured: TexturedScan) -> FloatArray:
    """Area of every face of a textured scan: (F,) m²."""
    a, b, c = (textured.vertices[textured.faces[:, corner]] for corner in range(3))
    areas: FloatArray = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return areas


def describe_camera(photo: Photo) -> str:
    """Model, size and focal length of a photo's camera, in words."""
    camera = camera_to_dict(photo.camera)
    text = f"{camera['model'].replace('_', ' ')}, {camera['width']} × {camera['height']}"
    if "K" in camera:
        text += f", f = {camera['K'][0][0]:.0f} px"
    if photo.exif.focal_length:
        text += f" ({photo.exif.focal_length:g} mm)"
    return text
