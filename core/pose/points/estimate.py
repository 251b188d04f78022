"""The pose of a photo from pixels and the coordinates they show."""

from __future__ import annotations

from dataclasses import dataclass
from math import lgamma, log, log10

import numpy as np

from ...arrays import ArrayLike, BoolArray, FloatArray
from ...cameras.base import Camera
from ...errors import PoseNotFound
from ...geometry.rigid import rotation_angle
from ...jobs import Job, Progress, drain
from ...settings import PointSettings
from ..pose import Pose
from .consensus import search_poses
from .perturbation import PoseFit, camera_points, invert_scaled, minimise_pose
from .sightings import Sightings, sightings_from_pixels


@dataclass(frozen=True, eq=False)
class PointPose(Pose):
    """A pose from points.

    `inliers` (N,) tells which points it rests on, `residuals` (N,2) is observed minus projected in pixels
    for every point, used or not (NaN where the camera model has no ray); `sigma` is the standard deviation of
    a pixel coordinate as estimated.
    """

    inliers: BoolArray
    residuals: FloatArray
    sigma: float


def estimate_pose_from_points(
    camera: Camera,
    pixels: ArrayLike,
    points: ArrayLike,
    active: ArrayLike | None = None,
    settings: PointSettings | None = None,
) -> PointPose:
    """Pose of a photo from at least four points; wrong ones are found and left out.

    pixels (N,2), the centre of the top-left pixel is (0, 0); points (N,3) world, metres; active (N,) bool:
    points to use. Raises `PoseNotFound` when the points are too few, collinear, in one spot, contradict each
    other or fit two poses. Source: method.md 2.7.
    """
    return drain(estimate_pose_from_points_job(camera, pixels, points, active, settings))


def estimate_pose_from_points_job(
    camera: Camera,
    pixels: ArrayLike,
    points: ArrayLike,
    active: ArrayLike | None = None,
    settings: PointSettings | None = None,
) -> Job[PointPose]:
    """Job of `estimate_pose_from_points`."""
    settings = settings or PointSettings()
    pixels, points, use = _checked(pixels, points, active)
    yield Progress(0.0, "Checking the points")
    # relative to a point on the spot: world coordinates may be millions of metres
    origin = points[use].mean(axis=0)
    everything = sightings_from_pixels(camera, pixels, points - origin)
    use = use & np.isfinite(everything.rays).all(axis=1)
    _refuse_degenerate(everything.select(use))
    yield Progress(0.2, "Searching the pose most points agree on")
    sightings = everything.select(use)
    candidates = search_poses(sightings, settings)
    if not candidates:
        raise PoseNotFound("No camera sees these points at these pixels: check which point is which.")
    yield Progress(0.7, "Refining the pose")
    frame = float(camera.width * camera.height)
    solution = _best_solution(sightings, candidates, frame, settings)
    fit = solution.fit
    inliers = np.zeros(len(pixels), dtype=bool)
    inliers[use] = solution.inliers
    residuals = _reported_residuals(camera, pixels, everything, fit)
    centre = fit.centre + origin
    return PointPose(
        fit.rotation, -fit.rotation @ centre, solution.covariance, inliers, residuals, solution.sigma
    )


def _reported_residuals(
    camera: Camera, pixels: FloatArray, everything: Sightings, fit: PoseFit
) -> FloatArray:
    """Observed minus projected (N,2) in pixels; linear where the projection fails or crosses a seam."""
    in_camera = camera_points(fit.rotation, fit.centre, everything.points)
    exact = pixels - camera.project(in_camera)
    linear = -everything.residuals(fit.rotation, fit.centre)
    usable = np.isfinite(exact).all(axis=1) & (np.abs(exact) < 0.5 * camera.width).all(axis=1)
    out: FloatArray = np.where(usable[:, None], exact, linear)
    return out


def _checked(
    pixels: ArrayLike, points: ArrayLike, active: ArrayLike | None
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Arrays of the right shape, and the points to use; raises `PoseNotFound`."""
    pixels = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    if len(pixels) != len(points):
        raise PoseNotFound(f"{len(pixels)} pixels for {len(points)} points: every point needs one pixel.")
    use = np.ones(len(pixels), dtype=bool) if active is None else np.asarray(active, dtype=bool).copy()
    use &= np.isfinite(pixels).all(axis=1) & np.isfinite(points).all(axis=1)
    if use.sum() < 4:
        raise PoseNotFound(
            f"Only {int(use.sum())} usable points: a pose needs four, better six all over the photo."
        )
    return pixels, points, use


def _refuse_degenerate(sightings: Sightings) -> None:
    """Raise `PoseNotFound` for points on one line or in one spot, in the world or in the photo."""
    if len(sightings) < 4:
        raise PoseNotFound(
            f"Only {len(sightings)} of the points lie inside the camera's field of view: a pose needs four."
        )
    spread = np.linalg.svd(sightings.points - sightings.points.mean(axis=0), compute_uv=False)
    if spread[0] < 1e-6:
        raise PoseNotFound("All points have the same coordinates: pick points spread over the scan.")
    if spread[1] < 1e-3 * spread[0]:
        raise PoseNotFound("The points lie on one line: add a point well off it.")
    rays = sightings.rays - sightings.rays.mean(axis=0)
    pixel = 1.0 / np.linalg.norm(sightings.to_pixels, axis=(1, 2)).mean()
    if np.linalg.norm(rays, axis=1).max() < 10 * pixel:
        raise PoseNotFound("All pixels lie in one spot of the photo: pick points spread over it.")


@dataclass(frozen=True, eq=False)
class _Solution:
    fit: PoseFit
    inliers: BoolArray
    sigma: float
    covariance: FloatArray


def _best_solution(
    sightings: Sightings,
    candidates: list[tuple[FloatArray, FloatArray]],
    frame: float,
    settings: PointSettings,
) -> _Solution:
    """Refine the candidates, return the best; raises `PoseNotFound` when it is chance or one of two."""
    solutions = [_refine(sightings, *candidate, settings) for candidate in candidates]
    costs = [_truncated_cost(sightings, s, solutions[0].sigma) for s in solutions]
    ranked = [solutions[int(i)] for i in np.argsort(costs)]
    best = ranked[0]
    _refuse_chance(best.inliers, frame, settings)
    _refuse_loose(best, sightings, settings)
    reference = _truncated_cost(sightings, best, best.sigma)
    for rival in ranked[1:]:
        worse = _truncated_cost(sightings, rival, best.sigma) - reference
        if worse < 9.0 and _differs(best, rival):
            angle = float(np.degrees(rotation_angle(rival.fit.rotation @ best.fit.rotation.T)))
            apart = float(np.linalg.norm(rival.fit.centre - best.fit.centre))
            raise PoseNotFound(
                f"Two poses, {angle:.1f} degrees and {apart:.2f} m apart, explain these points equally well: "
                "add a point at another depth."
            )
    return best


def _refine(
    sightings: Sightings, rotation: FloatArray, centre: FloatArray, settings: PointSettings
) -> _Solution:
    """Robust refinement, then least squares on the points it keeps."""
    robust = minimise_pose(rotation, centre, sightings.linearise, scale=2 * settings.sigma)
    errors = np.linalg.norm(sightings.residuals(robust.rotation, robust.centre), axis=1)
    inliers = errors <= _inlier_limit(errors, settings)
    if inliers.sum() < 4:
        return _Solution(robust, inliers, settings.sigma, np.full((6, 6), np.inf))
    fit = minimise_pose(robust.rotation, robust.centre, sightings.select(inliers).linearise)
    # a prior worth four points keeps the estimate sane where the points hardly outnumber the unknowns
    freedom = 2 * int(inliers.sum()) - 6
    sigma = float(np.sqrt((8 * settings.sigma**2 + fit.cost) / (8 + freedom)))
    return _Solution(fit, inliers, sigma, sigma**2 * invert_scaled(fit.hessian))


def _inlier_limit(errors: FloatArray, settings: PointSettings) -> float:
    """Largest error of a kept point: 3.7 sigma (99.9 % of a 2-D normal), sigma from the median error."""
    close = errors[errors <= settings.threshold]
    sigma = np.median(close) / 1.177 if len(close) >= 8 else settings.sigma
    return float(min(settings.threshold, 3.7 * max(sigma, 0.25 * settings.sigma)))


def _truncated_cost(sightings: Sightings, solution: _Solution, sigma: float) -> float:
    errors = sightings.residuals(solution.fit.rotation, solution.fit.centre) / sigma
    return float(np.minimum(np.einsum("ni,ni->n", errors, errors), 13.8).sum())


def _differs(best: _Solution, rival: _Solution) -> bool:
    """Whether two solutions are different poses, beyond the uncertainty of the better one."""
    angle = rotation_angle(rival.fit.rotation @ best.fit.rotation.T)
    apart = np.linalg.norm(rival.fit.centre - best.fit.centre)
    sigmas = np.sqrt(np.trace(best.covariance[:3, :3])), np.sqrt(np.trace(best.covariance[3:, 3:]))
    return bool(angle > 5 * sigmas[0] or apart > 5 * sigmas[1])


def _refuse_chance(inliers: BoolArray, frame: float, settings: PointSettings) -> None:
    """Raise `PoseNotFound` when as many points would agree by chance.

    Source: number of false alarms, Moisan and Stival 2004, with a three-point model of up to four solutions.
    """
    total, agreeing = len(inliers), int(inliers.sum())
    share = min(0.99, np.pi * settings.threshold**2 / frame)
    if agreeing > 3:
        alarms = log10(4 * (total - 3)) + _log10_comb(total, agreeing) + _log10_comb(agreeing, 3)
        alarms += (agreeing - 3) * log10(share)
        if alarms < -2:
            return
    raise PoseNotFound(
        f"Only {agreeing} of {total} points agree on a pose, no more than by chance: check which point is "
        "which, the coordinate order and the camera's focal length."
    )


def _log10_comb(n: int, k: int) -> float:
    return (lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1)) / log(10)


def _refuse_loose(best: _Solution, sightings: Sightings, settings: PointSettings) -> None:
    """Raise `PoseNotFound` when the agreeing points do not hold the pose."""
    rotation_sigma = float(np.degrees(np.sqrt(np.trace(best.covariance[:3, :3]))))
    centre_sigma = float(np.sqrt(np.trace(best.covariance[3:, 3:])))
    chosen = sightings.points[best.inliers]
    spread = np.linalg.svd(chosen - chosen.mean(axis=0), compute_uv=False)
    if spread[1] < 1e-3 * spread[0]:
        raise PoseNotFound("The points that agree lie on one line: add a point well off it.")
    if rotation_sigma > settings.max_rotation_sigma:
        raise PoseNotFound(
            f"The points hold the camera only to {rotation_sigma:.1f} degrees and {centre_sigma:.2f} m: "
            "add points farther apart."
        )
