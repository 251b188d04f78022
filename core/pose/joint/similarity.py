"""Bring cameras solved elsewhere onto the scan: scale, rotation and shift from what both sides know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import ArrayLike, BoolArray, FloatArray
from ...errors import PoseNotFound
from ..pose import Pose


@dataclass(frozen=True, eq=False)
class Similarity:
    """`x_scan = scale * rotation @ x_other + translation` (m).

    `inliers` (N,): pairs it rests on; `residuals` (N,) m of all pairs; `sigma`: standard deviation (m) of a
    coordinate of a pair.
    """

    scale: float
    rotation: FloatArray
    translation: FloatArray
    inliers: BoolArray
    residuals: FloatArray
    sigma: float

    def points(self, points: ArrayLike) -> FloatArray:
        """Points of the other frame in the scan's: (N,3) -> (N,3) m."""
        moved: FloatArray = self.scale * np.asarray(points, dtype=np.float64) @ self.rotation.T
        return moved + self.translation

    def pose(self, rotation: ArrayLike, translation: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """A camera pose (3,3), (3,) of the other frame in the scan's; world to camera, metres."""
        turned = np.asarray(rotation, dtype=np.float64) @ self.rotation.T
        return turned, self.scale * np.asarray(translation, dtype=np.float64) - turned @ self.translation


def estimate_similarity(
    other: ArrayLike, scan: ArrayLike, threshold: float = 0.1, seed: int = 0
) -> Similarity:
    """Similarity from points (N,3) of another frame and the same points (N,3) m on the scan, N >= 3.

    Pairs farther off than `threshold` (m) are left out. Camera centres serve as points too. Raises
    `PoseNotFound` for fewer than three agreeing pairs or pairs on one line. Source: Umeyama 1991 in RANSAC.
    """
    source = np.asarray(other, dtype=np.float64).reshape(-1, 3)
    target = np.asarray(scan, dtype=np.float64).reshape(-1, 3)
    if len(source) != len(target):
        raise PoseNotFound(
            f"{len(source)} points were given for {len(target)} on the scan: they go in pairs."
        )
    if len(source) < 3:
        raise PoseNotFound(f"Only {len(source)} pairs: placing the cameras on the scan takes at least three.")
    _refuse_line(source)
    rng = np.random.default_rng(seed)
    best: BoolArray = np.zeros(len(source), dtype=bool)
    for _ in range(1 if len(source) == 3 else 500):
        triple = rng.choice(len(source), 3, replace=False)
        if not _on_line(source[triple]):
            agreeing = _misfit(umeyama(source[triple], target[triple]), source, target) < threshold
            best = agreeing if agreeing.sum() > best.sum() else best
    for _ in range(5):
        if best.sum() < 3:
            raise PoseNotFound(
                f"No three of the {len(source)} pairs agree within {threshold:g} m: check which is which."
            )
        fit = umeyama(source[best], target[best])
        residuals = _misfit(fit, source, target)
        best = residuals < threshold
    _refuse_line(source[best])
    freedom = max(3 * int(best.sum()) - 7, 1)
    sigma = float(np.sqrt((residuals[best] ** 2).sum() / freedom))
    return Similarity(*fit, best, residuals, sigma)


def similarity_from_poses(
    other: Sequence[tuple[ArrayLike, ArrayLike]], scan: Sequence[Pose | None], threshold: float = 0.3
) -> Similarity:
    """Similarity from cameras (rotation, translation) of another frame and poses of some of them on the scan.

    Three cameras that are not on one line, or more; None stands for a camera that is not placed yet.
    """
    pairs = [(o, s) for o, s in zip(other, scan, strict=True) if s is not None]
    centres = [-np.asarray(r, dtype=np.float64).T @ np.asarray(t, dtype=np.float64) for (r, t), _ in pairs]
    return estimate_similarity(np.reshape(centres, (-1, 3)), [s.centre for _, s in pairs], threshold)


def umeyama(source: FloatArray, target: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Least-squares scale, rotation (3,3) and translation (3,) from points (N,3) to points (N,3).

    Source: Umeyama 1991, eq. 40-42; relative to the centroids, so that large coordinates lose no digits.
    """
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    a, b = source - source_mean, target - target_mean
    u, singular, vt = np.linalg.svd(b.T @ a)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * signs) @ vt
    scale = float((singular * signs).sum() / (a**2).sum())
    return scale, rotation, target_mean - scale * rotation @ source_mean


def _misfit(fit: tuple[float, FloatArray, FloatArray], source: FloatArray, target: FloatArray) -> FloatArray:
    scale, rotation, translation = fit
    out: FloatArray = np.linalg.norm(scale * source @ rotation.T + translation - target, axis=1)
    return out


def _on_line(points: FloatArray) -> bool:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] < 1e-3 * max(spread[0], 1e-300))


def _refuse_line(points: FloatArray) -> None:
    if _on_line(points):
        raise PoseNotFound(
            "The pairs lie on one line and leave a turn about it open: add a pair well off it."
        )
