"""Camera pose from regions: the stages in order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...arrays import ArrayLike, FloatArray
from ...cameras.base import Camera
from ...errors import PoseNotFound
from ...jobs import Job, Progress, drain
from ...regions import ImageRegion, SurfaceRegion
from ...settings import PoseSettings
from ..pose import Pose
from .algebraic import Candidates, joined, moment_costs, refine_by_moments
from .ambiguity import distinct, plausible
from .contour import contour_pairs, distances_of, lock_ratio, refine_by_contours
from .covariance import moment_covariance, world_covariance
from .initial import starting_poses
from .overlap import overlap_errors
from .problem import Problem, make_problem
from .region_pose import RegionPose

MOST = 8
"""Candidates kept per region, and over all."""

PLAUSIBLE = 16.0
"""Cost above the best, in its noise variance, up to which another pose explains the regions as well."""

SCALES = (*np.geomspace(6.0, 0.3, 14), 0.3, 0.3, 0.3)
"""Pixels at which a distance loses its weight, step by step of the contour stage."""

LOCK = 30.0
"""Lock ratio from which the contour stage is believed."""

Regions = ImageRegion | Sequence[ImageRegion]
Surfaces = SurfaceRegion | Sequence[SurfaceRegion]


def estimate_pose(
    camera: Camera,
    image_regions: Regions,
    surface_regions: Surfaces,
    paired: bool = True,
    up: ArrayLike | None = None,
    initial: Pose | None = None,
    settings: PoseSettings | None = None,
) -> RegionPose:
    """Pose of a photo from regions seen in it and on the scan.

    Parameters
    ----------
    camera
        Any central camera.
    image_regions, surface_regions
        One or several; with `paired` the i-th of one belongs to the i-th of the other, otherwise only their
        unions show the same and the numbers may differ (eq. 3.22).
    up
        Direction (3,) in the world that points up in the photo, roughly; it decides between solutions.
    initial
        A rough pose, tried first and preferred among solutions that explain the regions equally well.

    Raises
    ------
    RegionError
        A region that cannot be used.
    PoseNotFound
        No pose makes the regions overlap; the text says what was reached.

    Source: Alg. 2 and 3 in a chart per region, with the residuals and stages described in `docs/pose.md`.
    """
    return drain(estimate_pose_job(camera, image_regions, surface_regions, paired, up, initial, settings))


def estimate_pose_job(
    camera: Camera,
    image_regions: Regions,
    surface_regions: Surfaces,
    paired: bool = True,
    up: ArrayLike | None = None,
    initial: Pose | None = None,
    settings: PoseSettings | None = None,
) -> Job[RegionPose]:
    """Like `estimate_pose`, in steps."""
    settings = settings or PoseSettings()
    images = [image_regions] if isinstance(image_regions, ImageRegion) else list(image_regions)
    surfaces = [surface_regions] if isinstance(surface_regions, SurfaceRegion) else list(surface_regions)
    yield Progress(0.0, "Reading the regions' outlines")
    problem = make_problem(camera, images, surfaces, paired)
    yield Progress(0.2, "Searching for poses that fit the regions")
    candidates = _candidates(problem, up, initial)
    yield Progress(0.6, "Fitting the outlines")
    return _solution(problem, candidates, settings)


def _candidates(problem: Problem, up: ArrayLike | None, initial: Pose | None) -> Candidates:
    """Distinct poses that fit the moments, best first."""
    found = []
    for pair in problem.pairs:
        for part in pair.parts:
            starts = starting_poses(pair.chart, pair.outline, part)
            found.append(refine_by_moments([pair], starts, 8).sorted()[:MOST])
    if initial is not None:
        shifted = initial.rotation @ problem.origin + initial.translation
        found.append(Candidates(np.asarray(initial.rotation)[None], shifted[None], np.zeros(1)))
    several = joined(found)
    costs = moment_costs(problem.pairs, several.rotations, several.translations)
    several = distinct(Candidates(several.rotations, several.translations, costs))[:MOST]
    if len(several) == 0:
        raise PoseNotFound(
            "No camera position sees all regions at once: check that each has its right partner."
        )
    fitted = distinct(refine_by_moments(problem.pairs, several, 30))
    if up is not None:
        fitted = _upright(fitted, np.asarray(up, dtype=np.float64))
    return fitted


def _upright(candidates: Candidates, up: FloatArray) -> Candidates:
    """Keep the candidates in which `up` points up in the photo, unless there is none."""
    upwards = -(candidates.rotations @ (up / np.linalg.norm(up)))[:, 1]
    chosen = np.flatnonzero(upwards > 0)
    return candidates[chosen] if len(chosen) else candidates


def _solution(problem: Problem, candidates: Candidates, settings: PoseSettings) -> RegionPose:
    """Best pose with its alternatives."""
    equations = sum(len(pair.moments) for pair in problem.pairs)
    likely = candidates[plausible(candidates.costs, equations, PLAUSIBLE)]
    poses = [_finished(problem, likely.rotations[k], likely.translations[k]) for k in range(len(likely))]
    poses.sort(key=lambda pose: (not pose.locked, pose.overlap_error))
    best = poses[0]
    if best.overlap_error > settings.overlap_limit:
        raise PoseNotFound(
            f"The best pose leaves {best.overlap_error:.1f} % of the regions apart "
            f"(limit {settings.overlap_limit:g} %): check that each region has its right partner and outline."
        )
    others = tuple(pose for pose in poses[1:] if pose.locked or not best.locked)
    reason = f"{len(others)} other poses explain the regions as well" if others else ""
    return replace(best, alternatives=others, ambiguous=bool(others), reason=reason)


def _finished(problem: Problem, rotation: FloatArray, translation: FloatArray) -> RegionPose:
    """Pose after the contour stage where that locks, else as the moments gave it."""
    covariance = moment_covariance(problem.pairs, rotation, translation)
    locked = False
    if problem.paired:
        contours = contour_pairs(
            problem.camera, problem.pixel_loops, problem.surface_loops, rotation, translation
        )
        turned, moved = refine_by_contours(problem.camera, contours, rotation, translation, SCALES)
        locked = lock_ratio(distances_of(problem.camera, contours, turned, moved)) > LOCK
        if locked:
            rotation, translation = turned, moved
    overlap, each = overlap_errors(problem.pairs, rotation, translation)
    return RegionPose(
        rotation,
        translation - rotation @ problem.origin,
        world_covariance(covariance, rotation, translation),
        overlap_error=overlap,
        region_errors=each,
        locked=locked,
    )
