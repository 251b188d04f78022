"""Bringing scans into one frame by points that are known in both: `x_target = R x_source + t` (eq. 3.33)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import ArrayLike, FloatArray
from ..errors import ScanError

_COLLINEAR = 1e-2
"""Points whose spread across their main direction is less than this part of the spread along it."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """A rigid motion `x_target = rotation @ x_source + translation` (m) and how well it fits.

    `residuals` (N,) are the distances in metres that remain, of the pairs or of the points that were used;
    `rms` their root mean square; `overlap` the share of the source that has a counterpart.
    """

    rotation: FloatArray
    translation: FloatArray
    residuals: FloatArray
    overlap: float = 1.0

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, metres."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    def apply(self, points: ArrayLike) -> FloatArray:
        """Move points (N,3) of the source into the frame of the target."""
        moved: FloatArray = np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation
        return moved


def align_by_points(source: ArrayLike, target: ArrayLike) -> Alignment:
    """Rigid motion that brings points (N,3) onto their partners (N,3), in the least-squares sense.

    Raises ScanError for fewer than three pairs, undefined coordinates, or points on one line.
    Source: method.md 3, eq. 3.33; Kabsch (1976) by singular value decomposition.
    """
    a, b = np.asarray(source, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if a.shape != b.shape or a.ndim != 2 or a.shape[1] != 3:
        raise ScanError(f"point pairs need as many points in both scans, not {len(a)} and {len(b)}")
    if len(a) < 3:
        raise ScanError(f"{len(a)} point pairs cannot align scans; pick three or more, not on one line")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise ScanError("a point pair has undefined coordinates; pick it again")
    middle_a, middle_b = a.mean(axis=0), b.mean(axis=0)
    u, singular, vt = np.linalg.svd((b - middle_b).T @ (a - middle_a))
    if singular[1] <= _COLLINEAR**2 * singular[0]:
        raise ScanError(
            "the picked points lie on one line: the scans could still turn about it; pick another point"
        )
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])  # a mirrored fit is no motion
    rotation = u @ flip @ vt
    residuals = np.linalg.norm((a - middle_a) @ rotation.T - (b - middle_b), axis=1)
    return Alignment(rotation, middle_b - rotation @ middle_a, residuals)
