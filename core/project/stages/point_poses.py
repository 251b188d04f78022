"""Poses from surveyed points: picked by hand or found as markers in the photos, matched by name or place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...arrays import FloatArray
from ...errors import PoseNotFound, ScanError
from ...jobs import Job, Progress
from ...photos.image import read_image
from ...photos.photo import Photo
from ...pose.points import PointPose, estimate_pose_from_points_job
from ...pose.points.markers import (
    FAMILIES,
    Marker,
    detect_checkerboard_markers,
    detect_coded_markers,
    detect_round_markers,
)
from ...pose.points.survey import Survey, match_by_name, match_by_place, read_survey
from ...pose.pose import Pose
from ...settings import PointSettings
from ..digest import code_digest, digest, file_digest
from ..store import Store
from .photo_pose import PhotoPose, PointSighting

MARKERS = ("checkerboard", "circles", *FAMILIES)
"""Kinds of markers that are found by themselves; squares of a family carry their name."""

Picks = Mapping[str, tuple[float, float]]
"""Pixels by the name of the point, (0, 0) the centre of the top-left pixel."""

_LEAST = 4


@dataclass(frozen=True)
class PointsEntry:
    """Surveyed points of a project: their table, in the world of the scan's file, and the markers on them.

    `reach` (pixels) is how far a marker without name may lie from where the pose from regions expects it.
    """

    path: Path
    markers: str = ""
    reach: float = 40.0
    settings: PointSettings = field(default_factory=PointSettings)


def read_picks(path: Path) -> dict[str, tuple[float, float]]:
    """Read a table of picked points: name, u, v; comma, semicolon, tab or blanks. Raises ScanError."""
    found: dict[str, tuple[float, float]] = {}
    for number, line in enumerate(path.read_text(encoding="utf-8-sig").splitlines(), 1):
        cells = line.replace(";", ",").replace("\t", ",").split(",") if _cut(line) else line.split()
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            name, u, v = cells[0].strip(), float(cells[1]), float(cells[2])
        except (IndexError, ValueError):
            if number == 1:  # titles of the columns
                continue
            raise ScanError(f"{path}: line {number}: a name and two pixels are needed: name, u, v.") from None
        found[name] = (u, v)
    return found


def _cut(line: str) -> bool:
    return any(sign in line for sign in ",;\t")


def find_markers(photo: Photo, kind: str) -> list[Marker]:
    """Find the markers of a kind in a photo. Raises PhotoError for a photo that cannot be read."""
    image = read_image(photo.path)
    if kind == "checkerboard":
        return _distinct(detect_checkerboard_markers(image))
    return detect_round_markers(image) if kind == "circles" else detect_coded_markers(image, kind)


def _distinct(markers: Sequence[Marker]) -> list[Marker]:
    """Leave out markers that are another one found twice: neighbouring pixels lead to the same corner."""
    found: list[Marker] = []
    for marker in markers:
        if all(np.linalg.norm(marker.pixel - other.pixel) > 1 for other in found):
            found.append(marker)
    return found


def read_points(entry: PointsEntry, offset: FloatArray) -> Survey:
    """Surveyed points in the scan's local coordinates. Raises ScanError."""
    survey = read_survey(entry.path)
    return Survey(survey.names, survey.points - offset)


def match_markers(
    photo: Photo, markers: Sequence[Marker], survey: Survey, start: Pose | None, reach: float
) -> dict[str, tuple[float, float]]:
    """Pixels of surveyed points among the markers: by their code, or by where a pose expects them."""
    pixels, _, names = match_by_name(markers, survey)
    if not names and start is not None:
        unnamed = [marker for marker in markers if not marker.name]
        pixels, _, names = match_by_place(unnamed, survey, photo.camera, start.rotation, start.centre, reach)
    return {name: (float(u), float(v)) for name, (u, v) in zip(names, pixels, strict=True)}


def pose_from_points_job(
    photo: Photo, survey: Survey, picks: Picks, settings: PointSettings | None = None
) -> Job[PhotoPose]:
    """Find the pose of a photo from picked points; `failure` says why where there is none.

    Points that do not agree with the others are found and told, not used.
    """
    names = [name for name in picks if name in survey.names]
    unknown = sorted(set(picks) - set(names))
    notes = [f"Not in the table of points: {', '.join(unknown)}."] if unknown else []
    pixels = np.array([picks[name] for name in names]).reshape(-1, 2)
    points = survey.points[[survey.names.index(name) for name in names]]
    try:
        pose: PointPose = yield from estimate_pose_from_points_job(
            photo.camera, pixels, points, settings=settings
        )
    except PoseNotFound as error:
        return PhotoPose(photo.name, None, str(error), notes=tuple(notes))
    wrong = [name for name, used in zip(names, pose.inliers, strict=True) if not used]
    if wrong:
        notes.append(f"Left out because they contradict the others: {', '.join(wrong)}.")
    sightings = tuple(
        PointSighting(name, (float(p[0]), float(p[1])), (float(r[0]), float(r[1])), bool(used))
        for name, p, r, used in zip(names, pixels, pose.residuals, pose.inliers, strict=True)
    )
    plain = Pose(pose.rotation, pose.translation, pose.covariance)
    return PhotoPose(photo.name, plain, notes=tuple(notes), points=sightings)


def solve_points_job(
    photos: Sequence[Photo],
    picks: Sequence[Picks],
    before: Sequence[PhotoPose],
    entry: PointsEntry,
    offset: FloatArray,
    store: Store,
) -> Job[list[PhotoPose]]:
    """Poses of photos from points where they have enough; the others keep what they have `before`.

    Points that were picked but lead to no pose are told beside the pose that is kept. Raises ScanError for a
    table that cannot be read, PhotoError for a photo.
    """
    survey, found = read_points(entry, offset), []
    for number, (photo, picked, result) in enumerate(zip(photos, picks, before, strict=True)):
        yield Progress(number / len(photos), f"Points of {photo.name}")
        own = dict(picked)
        if entry.markers:
            start = result.pose if result.solved else None
            own = {**_kept_markers(photo, entry, survey, start, store), **own}
        if not picked and len(own) < _LEAST:
            found.append(result)
            continue
        posed = yield from pose_from_points_job(photo, survey, own, entry.settings)
        found.append(posed if posed.solved or not result.solved else _told(result, posed))
    return found


def _told(result: PhotoPose, failed: PhotoPose) -> PhotoPose:
    """Return an earlier result that says why the points did not replace it."""
    notes = (*result.notes, f"Not posed by points: {failed.failure}", *failed.notes)
    return PhotoPose(**{**vars(result), "notes": notes})


def _kept_markers(
    photo: Photo, entry: PointsEntry, survey: Survey, start: Pose | None, store: Store
) -> dict[str, tuple[float, float]]:
    """Find markers, or take those of an earlier run."""
    key = digest(code_digest(), file_digest(photo.path), entry.markers) if store.folder is not None else ""
    saved = store.load(f"markers {photo.name}", key)
    if saved is None:
        markers = find_markers(photo, entry.markers)
        plain = {"names": [m.name for m in markers], "pixels": [m.pixel.tolist() for m in markers]}
        store.save(f"markers {photo.name}", key, plain)
    else:
        pairs = zip(saved["names"], saved["pixels"], strict=True)
        markers = [Marker(name, np.array(pixel)) for name, pixel in pairs]
    return match_markers(photo, markers, survey, start, entry.reach)
