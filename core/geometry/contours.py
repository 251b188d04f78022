"""Closed polylines as smooth curves: even sampling, local quadratic fits for position and direction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..arrays import FloatArray


@dataclass(frozen=True, eq=False)
class SmoothCurve:
    """Points (n,d) of a closed curve, unit tangents (n,d), root-mean-square misfit there (n,)."""

    points: FloatArray
    tangents: FloatArray
    misfits: FloatArray


def resampled(loop: FloatArray, step: float) -> FloatArray:
    """Points (m,d) along a closed polyline (n,d), evenly spaced by about `step`."""
    closed = np.concatenate([loop, loop[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    count = max(8, round(length[-1] / step))
    at = np.arange(count) * (length[-1] / count)
    points: FloatArray = np.stack([np.interp(at, length, closed[:, k]) for k in range(loop.shape[1])], axis=1)
    return points


def smoothed(loop: FloatArray, half_width: int) -> SmoothCurve:
    """Quadratic fit in a window of 2 `half_width` + 1 evenly spaced points: (n,d) -> SmoothCurve.

    Steps and noise average out while curvature stays (no shrinking); at corners the misfit is large.
    Source: Savitzky and Golay 1964.
    """
    half_width = min(half_width, (len(loop) - 1) // 2)
    value, slope = _quadratic_kernels(half_width)
    points, tangents = _circular(loop, value), _circular(loop, slope)
    tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-300)
    off = loop - points
    off = off - np.sum(off * tangents, axis=1, keepdims=True) * tangents
    width = 2 * half_width + 1
    mean_square = _circular(np.sum(off * off, axis=1)[:, None], np.full(width, 1.0 / width))[:, 0]
    return SmoothCurve(points, tangents, np.sqrt(mean_square))


@lru_cache(maxsize=32)
def _quadratic_kernels(half_width: int) -> tuple[FloatArray, FloatArray]:
    at = np.arange(-half_width, half_width + 1, dtype=np.float64)
    design = np.stack([np.ones_like(at), at, at * at], axis=1)
    fit = np.linalg.pinv(design)
    return fit[0], fit[1]


def _circular(values: FloatArray, kernel: FloatArray) -> FloatArray:
    """Circular correlation of the rows of `values` (n,d) with an odd kernel."""
    half = len(kernel) // 2
    padded = np.concatenate([values[len(values) - half :], values, values[:half]])
    result: FloatArray = np.stack(
        [np.correlate(padded[:, k], kernel, mode="valid") for k in range(values.shape[1])], axis=1
    )
    return result
