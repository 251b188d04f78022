"""Fisheye cameras: the distance from the image centre is a polynomial of the angle off the axis."""

from __future__ import annotations

from functools import cached_property
from typing import Self

import numpy as np

from ..arrays import ArrayLike, FloatArray
from ..errors import CameraError
from .distortion import NO_DISTORTION, Distortion, first_fold, series, series_slope
from .monotone import MonotoneInverse
from .plane import PlaneCamera

_MOST_COEFFICIENTS = 6
_TABLE_SIZE = 513


class FisheyeCamera(PlaneCamera):
    """Kannala–Brandt: `x = K (rho / r) (X, Y)` with `rho = t + k1 t^3 + k2 t^5 + ...`, t the angle off axis.

    Sees every direction whose angle lies below the first fold of the polynomial, at most 180 degrees.

    Parameters
    ----------
    width, height
        Size of the photo in pixels.
    K
        Camera matrix (3,3) in pixels, origin at the centre of the top-left pixel; skew K[0,1] is allowed.
    distortion
        k1, k2, k3, k4 of OpenCV's fisheye model, fewer, or up to k6; none is the equidistant lens.
    plane_distortion
        Distortion of the plane after the polynomial: COLMAP's and Metashape's fisheyes have one.

    Raises
    ------
    CameraError
        Sizes, matrix or coefficients that make no sense.

    The attribute `coefficients` holds k1, k2, ..., and `distortion` that of the plane.
    Source: Kannala and Brandt 2006; OpenCV's fisheye model for the order of the coefficients.
    """

    def __init__(
        self,
        width: int,
        height: int,
        K: ArrayLike,
        distortion: ArrayLike = (),
        plane_distortion: Distortion = NO_DISTORTION,
    ):
        super().__init__(width, height, K, plane_distortion)
        given = np.asarray(distortion, dtype=np.float64).ravel()
        if given.size > _MOST_COEFFICIENTS or not np.all(np.isfinite(given)):
            raise CameraError(
                f"A fisheye lens takes up to {_MOST_COEFFICIENTS} finite coefficients k1, k2, ..."
            )
        self.coefficients: tuple[float, ...] = tuple(given.tolist())

    @cached_property
    def field_angle(self) -> float:
        """Largest angle off the axis (rad) that the polynomial reaches before it folds back, at most pi."""
        return min(first_fold(self.coefficients, ()), np.pi)

    @cached_property
    def _angle(self) -> MonotoneInverse:
        """Angle off the axis of a radius on the plane."""
        nodes = np.linspace(0, self.field_angle * (1 - 1e-15), _TABLE_SIZE)
        return MonotoneInverse(self._radius_with_slope, nodes)

    def _radius_with_slope(self, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
        s = angle * angle
        value = series(self.coefficients, s)
        return angle * value, value + 2 * s * series_slope(self.coefficients, s)

    def _gain(self, points: FloatArray) -> FloatArray:
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        r = np.sqrt(x * x + y * y)
        angle = np.arctan2(r, z)
        radius = angle * series(self.coefficients, angle * angle)
        on_axis = np.divide(1.0, z, out=np.full(z.shape, np.nan), where=(r == 0) & (z > 0))
        return np.divide(radius, r, out=on_axis, where=(angle < self.field_angle) & (r > 0))

    def _gain_with_slopes(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        gain = self._gain(points)
        z = points[..., 2]
        s = points[..., 0] ** 2 + points[..., 1] ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = self._radius_with_slope(np.arctan2(np.sqrt(s), z))[1] / (s + z * z)
        slope = np.where(np.isnan(gain), np.nan, slope)
        slope_s = np.divide(slope * z - gain, 2 * s, out=np.zeros(z.shape), where=s > 0)
        return gain, slope_s, -slope

    def _from_plane(self, x: FloatArray, y: FloatArray) -> FloatArray:
        rho = np.hypot(x, y)
        angle = self._angle(rho)
        side = np.divide(np.sin(angle), rho, out=np.ones(rho.shape), where=rho > 0)
        cosine = np.cos(angle)
        side = np.where(np.isnan(cosine), np.nan, side)
        return np.stack([x * side, y * side, cosine], axis=-1)

    def _with_matrix(self, width: int, height: int, K: FloatArray) -> Self:
        return type(self)(width, height, K, self.coefficients, self.distortion)
