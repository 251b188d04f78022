"""What the user should know of a run that went through: what was mended, left out, or is not sure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from ..photos.photo import Photo
from ..regions.surface_region import SurfaceRegion
from ..scans.scan import Scan
from .run import ProjectResult
from .stages.photo_pose import PhotoPose, Refinement

WEAK_SHARE = 0.01
"""A camera centre less sure than this part of its distance to the regions is weakly determined."""

_NAMED = 3
"""Photos named where many share the same remark."""


def remarks(result: ProjectResult) -> list[str]:
    """Sentences on scan, photos, poses and texture, each beginning with what it speaks of."""
    shown = [] if result.textured is None else [result.textured]
    layers = [*shown, *result.layers.values()]
    warnings = dict.fromkeys(text for textured in layers for text in textured.selection.warnings)
    scans = (result.scan, *result.occluders)
    return [*remarks_on(scans, result.photos, result.poses, result.surfaces), *warnings]


def remarks_on(
    scans: Iterable[Scan],
    photos: Iterable[Photo],
    poses: Iterable[PhotoPose],
    surfaces: Mapping[str, SurfaceRegion],
) -> list[str]:
    """Sentences on scans, photos and poses; one that holds for several is told once."""
    of_scans = [(scan.name, sentence) for scan in scans for sentence in scan.report]
    of_photos = [(photo.name, note) for photo in photos for note in photo.notes]
    of_poses = [(pose.photo, text) for pose in poses for text in _on_pose(pose, surfaces)]
    return [*_together(of_scans), *_together(of_photos), *_together(of_poses)]


def _on_pose(pose: PhotoPose, surfaces: Mapping[str, SurfaceRegion]) -> list[str]:
    weak = weakness(pose, surfaces)
    kept = [step.note for step in pose.refinements if step.note]
    lenses = [_lens_sentence(step) for step in pose.refinements if step.lens]
    return [*pose.notes, *kept, *lenses, *([weak] if weak else [])]


def _lens_sentence(step: Refinement) -> str:
    return f"Lens adjusted: {step.lens}." if step.camera is not None else step.lens


def weakness(result: PhotoPose, surfaces: Mapping[str, SurfaceRegion]) -> str:
    """Sentence on a solved pose whose regions leave its centre loose; empty when they hold it."""
    regions = [surfaces[name].vertices for name in result.regions if name in surfaces]
    if result.given or not result.solved or result.pose is None or not regions:
        return ""
    middle = np.mean([vertices.mean(axis=0) for vertices in regions], axis=0)
    share = result.pose.centre_sigma / float(np.linalg.norm(middle - result.pose.centre))
    if share <= WEAK_SHARE:
        return ""
    count = "one region leaves" if len(regions) == 1 else f"{len(regions)} regions leave"
    return (
        f"Its {count} the pose weakly determined: the camera is known to "
        f"± {1000 * result.pose.centre_sigma:.0f} mm, {100 * share:.1f} % of its distance. Add a region, "
        "best on another wall."
    )


def _together(told: Iterable[tuple[str, str]]) -> list[str]:
    """One line per sentence, with the names it holds for; a long list of names is shortened."""
    names: dict[str, list[str]] = {}
    for name, sentence in told:
        names.setdefault(sentence, []).append(name)
    return [f"{_listed(of)}: {sentence}" for sentence, of in names.items()]


def _listed(names: list[str]) -> str:
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")
