"""Moments and areas of many polygons at once."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray


def polygon_moments(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centroids (N,2) and covariances (N,2,2) of filled polygons (N,n,2), by Green's theorem."""
    origin = corners.mean(axis=1, keepdims=True)
    a = corners - origin
    b = np.roll(a, -1, axis=1)
    cross = a[..., 0] * b[..., 1] - b[..., 0] * a[..., 1]
    area = cross.sum(axis=1) / 2
    safe = np.where(np.abs(area) > 1e-9, area, 1e-9)
    mean = np.sum((a + b) * cross[..., None], axis=1) / (6 * safe[:, None])
    ab = a[..., :, None] * b[..., None, :]
    second = (
        2 * (a[..., :, None] * a[..., None, :] + b[..., :, None] * b[..., None, :]) + ab + ab.swapaxes(-1, -2)
    )
    spread = np.sum(second * cross[..., None, None], axis=1) / (24 * safe[:, None, None])
    return mean + origin[:, 0], spread - mean[:, :, None] * mean[:, None, :]


def polygon_areas(corners: FloatArray) -> FloatArray:
    """Areas (N,) of polygons (N,n,2)."""
    following = np.roll(corners, -1, axis=1)
    cross = corners[..., 0] * following[..., 1] - following[..., 0] * corners[..., 1]
    areas: FloatArray = np.abs(cross.sum(axis=1)) / 2
    return areas
