"""Flat charts of the viewing sphere: one per region, so that all central cameras share one mathematics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray
from .rigid import rotation_between

GNOMONIC_LIMIT = np.radians(
    60.0
)  # a gnomonic chart stretches by 1/cos^2: fourfold here, without bound at 90 degrees


@dataclass(frozen=True, eq=False)
class Chart:
    """A map from directions in the camera frame to a plane, `scale * (flat(rotation @ direction) - offset)`.

    `rotation` (3,3) turns the chart's axis to z; `equal_area` chooses Lambert's azimuthal chart instead of
    the gnomonic one (the plane z = 1, in which straight lines of the world stay straight).
    """

    rotation: FloatArray
    offset: FloatArray
    scale: float
    equal_area: bool

    def flatten(self, points: FloatArray) -> FloatArray:
        """Chart coordinates of points: (...,3) camera frame -> (...,2), NaN behind a gnomonic chart."""
        turned = points @ self.rotation.T
        if self.equal_area:
            turned = turned / np.linalg.norm(turned, axis=-1, keepdims=True)
            factor = np.sqrt(2.0 / np.maximum(1.0 + turned[..., 2], 1e-9))
            flat = turned[..., :2] * factor[..., None]
        else:
            depth = np.where(turned[..., 2] > 0, turned[..., 2], np.nan)
            flat = turned[..., :2] / depth[..., None]
        result: FloatArray = (flat - self.offset) * self.scale
        return result

    def flatten_with_jacobian(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Chart coordinates and their derivative: (...,3) camera frame -> (...,2), (...,2,3)."""
        turned = points @ self.rotation.T
        if self.equal_area:
            flat, jacobian = _lambert(turned)
        else:
            depth = np.where(turned[..., 2] > 0, turned[..., 2], np.nan)
            inverse = 1.0 / depth
            flat = turned[..., :2] * inverse[..., None]
            jacobian = np.zeros((*points.shape[:-1], 2, 3))
            jacobian[..., 0, 0] = jacobian[..., 1, 1] = inverse
            jacobian[..., 2] = -flat * inverse[..., None]
        return (flat - self.offset) * self.scale, (jacobian @ self.rotation) * self.scale


def _lambert(turned: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lambert's azimuthal equal-area map of directions and its derivative: (...,3) -> (...,2), (...,2,3)."""
    radius = np.linalg.norm(turned, axis=-1)
    base = np.maximum(radius + turned[..., 2], 1e-9 * radius)
    # flat = xy * sqrt(2 / (r (r + z)))
    factor = np.sqrt(2.0 / (radius * base))
    flat = turned[..., :2] * factor[..., None]
    unit = turned / radius[..., None]
    slope = -0.5 * factor[..., None] * (unit / radius[..., None] + unit / base[..., None])
    slope[..., 2] -= 0.5 * factor / base
    jacobian = turned[..., :2, None] * slope[..., None, :]
    jacobian[..., 0, 0] += factor
    jacobian[..., 1, 1] += factor
    return flat, jacobian


def chart_around(rays: FloatArray) -> Chart:
    """Chart about the middle of a bundle of unit rays (N,3), with unit root-mean-square spread.

    Gnomonic where the bundle is narrower than `GNOMONIC_LIMIT` about its axis, equal-area beyond.
    """
    axis = _bundle_axis(rays[:: max(1, len(rays) // 200)])
    rotation = rotation_between(axis, np.array([0.0, 0.0, 1.0]))
    narrow = float(np.min(rays @ axis)) > np.cos(GNOMONIC_LIMIT)
    plain = Chart(rotation, np.zeros(2), 1.0, not narrow)
    flat = plain.flatten(rays)
    offset = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    spread = float(np.sqrt(np.mean(np.sum((flat - offset) ** 2, axis=1))))
    return Chart(rotation, offset, 1.0 / spread, not narrow)


def _bundle_axis(rays: FloatArray) -> FloatArray:
    """Axis of a narrow cone around unit rays (N,3): their mean, moved towards the farthest ray."""
    axis: FloatArray = rays.mean(axis=0)
    if np.linalg.norm(axis) < 1e-6:
        axis = rays[0]
    axis = axis / np.linalg.norm(axis)
    for step in range(1, 40):  # Badoiu and Clarkson's enclosing ball, on the sphere
        farthest = rays[np.argmin(rays @ axis)]
        axis = axis + (farthest - axis) / (step + 1)
        axis /= np.linalg.norm(axis)
    return axis
