"""Pose together with an unknown focal length, and if wanted the first radial distortion coefficient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from ...arrays import FloatArray
from ...cameras import PerspectiveCamera
from ...errors import PoseNotFound, RegionError
from ...geometry.rigid import exp_so3
from ...regions import ImageRegion, SurfaceRegion
from ...settings import PoseSettings
from ..pose import Pose
from .algebraic import Candidates, refine_by_moments
from .ambiguity import posed
from .contour import ContourPair, LensStep, Match, gauss_newton_step, lock_ratio, match
from .covariance import outline_covariance
from .estimate import estimate_pose
from .fitting import LEVELS, Contours, Level, OutlineFit
from .problem import Problem, make_problem
from .region_pose import RegionPose
from .search import moment_candidates

FLATNESS = 0.05
"""Share of the regions' extent that they must leave their common plane by."""

FACTORS = np.geomspace(0.5, 2.0, 9)
"""Focal lengths tried first, as multiples of the camera's own."""

STEPS = (6.0, 4.0, 3.0, 2.0, 1.5, 1.0, 0.7, 0.7, 0.7)
"""Multiples of a level's `near` at which distances lose their weight, step by step."""

SMALL = 1e-4
"""Change of a lens parameter for its numerical derivative."""


@dataclass(frozen=True, eq=False)
class CalibratedPose:
    """Camera with the focal length (and k1) found, the pose, and a standard deviation of each lens parameter.

    `focal_sigma` is in pixels of fx; `k1_sigma` is 0 where k1 was not estimated. The pose's covariance
    includes that the lens was unknown.
    """

    camera: PerspectiveCamera
    pose: RegionPose
    focal_sigma: float
    k1_sigma: float


def estimate_pose_and_focal(
    camera: PerspectiveCamera,
    image_regions: Sequence[ImageRegion],
    surface_regions: Sequence[SurfaceRegion],
    radial: bool = False,
    settings: PoseSettings | None = None,
) -> CalibratedPose:
    """Pose and focal length from at least three paired regions that do not lie in one plane.

    `camera` gives the principal point, the shape of the pixels, the distortion, and a focal length that may
    be wrong by a factor of two; with `radial`, k1 is estimated as well.

    Raises
    ------
    RegionError
        Fewer than three regions, or all nearly in one plane.
    PoseNotFound
        No pose and focal length make the outlines coincide.
    """
    settings = settings or PoseSettings()
    _check_depth(surface_regions)
    focal, start = _by_moments(camera, image_regions, surface_regions, settings)
    found = with_lens(camera, focal, None)
    problem = make_problem(found, image_regions, surface_regions, paired=True)
    rotation, translation = start.rotation, start.translation + start.rotation @ problem.origin
    for level in LEVELS:
        pairs = Contours(problem).pairs(level, rotation, translation)
        fit = _refined(found, pairs, rotation, translation, level, radial)
        if fit.holds(level):
            exact = make_problem(fit.camera, image_regions, surface_regions, paired=True)
            return _calibrated(exact, fit, level, start)
    raise PoseNotFound(
        "The outlines do not fit well enough to tell the focal length: give it, or draw them more carefully."
    )


@dataclass(frozen=True, eq=False)
class _LensFit:
    """Lens and pose after the outline stage, their covariance (P,P), distances left between outlines (px)."""

    camera: PerspectiveCamera
    rotation: FloatArray
    translation: FloatArray
    covariance: FloatArray
    distances: FloatArray

    def share(self, level: Level) -> float:
        return float(np.mean(np.abs(self.distances) < level.near))

    def holds(self, level: Level) -> bool:
        return lock_ratio(self.distances, level.near) > level.ratio and self.share(level) > level.share


def _calibrated(problem: Problem, fit: _LensFit, level: Level, start: RegionPose) -> CalibratedPose:
    outlines = OutlineFit(
        fit.rotation, fit.translation, fit.covariance[:6, :6], fit.share(level), level.near, 0.0, True
    )
    pose = replace(
        posed(problem, outlines),
        ambiguous=start.ambiguous,
        alternatives=start.alternatives,
        reason=start.reason,
    )
    sigmas = np.sqrt(np.diag(fit.covariance)[6:])
    k1_sigma = float(sigmas[1]) if len(sigmas) > 1 else 0.0
    return CalibratedPose(fit.camera, pose, float(fit.camera.K[0, 0] * sigmas[0]), k1_sigma)


def with_lens(camera: PerspectiveCamera, factor: float, k1: float | None) -> PerspectiveCamera:
    """Return the camera with its focal length multiplied by `factor` and, unless None, another k1."""
    matrix = np.array(camera.K)
    matrix[:2, :2] *= factor
    coefficients = list(camera.distortion.opencv) or [0.0]
    if k1 is None:
        return PerspectiveCamera(camera.width, camera.height, matrix, camera.distortion)
    coefficients[0] = k1
    return PerspectiveCamera(camera.width, camera.height, matrix, coefficients)


def _check_depth(surface_regions: Sequence[SurfaceRegion]) -> None:
    if len(surface_regions) < 3:
        raise RegionError(
            "An unknown focal length takes at least three regions: give the focal length or add regions."
        )
    points = np.concatenate([np.concatenate(region.loops) for region in surface_regions])
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if extents[2] < FLATNESS * extents[0]:
        raise RegionError(
            "The regions lie nearly in one plane, where focal length and distance cannot be told apart: "
            "add a region at another depth or give the focal length."
        )


def _by_moments(
    camera: PerspectiveCamera,
    image_regions: Sequence[ImageRegion],
    surface_regions: Sequence[SurfaceRegion],
    settings: PoseSettings,
) -> tuple[float, RegionPose]:
    """Focal factor at which the moments agree best, and the pose there."""

    def cost(log_factor: float, start: Pose) -> float:
        problem = make_problem(
            with_lens(camera, float(np.exp(log_factor)), None), image_regions, surface_regions, paired=True
        )
        shifted = start.rotation @ problem.origin + start.translation
        candidate = Candidates(start.rotation[None], shifted[None], np.zeros(1))
        return float(refine_by_moments(problem.moments, candidate, 20).costs[0])

    best, pose, factor = np.inf, None, 1.0
    for tried in FACTORS:
        problem = make_problem(with_lens(camera, tried, None), image_regions, surface_regions, paired=True)
        try:
            candidates = moment_candidates(problem, problem.sketches[0])
        except PoseNotFound:
            continue
        if candidates.costs[0] < best:
            best, factor = float(candidates.costs[0]), float(tried)
            rotation = candidates.rotations[0]
            pose = Pose(rotation, candidates.translations[0] - rotation @ problem.origin, np.eye(6))
    if pose is None:
        raise PoseNotFound("No focal length lets the camera see all regions: check their partners.")
    width = float(np.log(FACTORS[1] / FACTORS[0]))
    bounds = (np.log(factor) - width, np.log(factor) + width)
    result = minimize_scalar(cost, bounds=bounds, args=(pose,), method="bounded", options={"xatol": 1e-3})
    factor = float(np.exp(result.x))
    return factor, estimate_pose(
        with_lens(camera, factor, None),
        image_regions,
        surface_regions,
        initial=pose,
        settings=replace(settings, overlap_limit=100.0),
    )


def _refined(
    camera: PerspectiveCamera,
    pairs: Sequence[ContourPair],
    rotation: FloatArray,
    translation: FloatArray,
    level: Level,
    radial: bool,
) -> _LensFit:
    """Gauss-Newton on pose, log of the focal length, and k1 if it is free."""
    log_factor, k1 = 0.0, float((*camera.distortion.opencv, 0.0)[0])

    def lens(log_change: float, k1_change: float) -> PerspectiveCamera:
        return with_lens(camera, float(np.exp(log_factor + log_change)), k1 + k1_change if radial else None)

    def matched() -> list[Match]:
        steps = [LensStep(lens(SMALL, 0), lens(-SMALL, 0), 2 * SMALL)]
        if radial:
            steps.append(LensStep(lens(0, SMALL), lens(0, -SMALL), 2 * SMALL))
        return [match(lens(0, 0), pair, rotation, translation, steps) for pair in pairs]

    for scale in STEPS:
        step = gauss_newton_step(matched(), scale * level.near)
        rotation, translation = exp_so3(step[:3]) @ rotation, translation + step[3:6]
        log_factor += float(step[6])
        k1 += float(step[7]) if radial else 0.0
    last = matched()
    covariance = outline_covariance(pairs, last, STEPS[-1] * level.near)
    distances = np.concatenate([found.distances for found in last])
    return _LensFit(lens(0, 0), rotation, translation, covariance, distances)
