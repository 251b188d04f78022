"""The polynomial omnidirectional camera of Scaramuzza (OCamCalib)."""

from __future__ import annotations

from functools import cached_property
from typing import Self

import numpy as np

from ..arrays import ArrayLike, FloatArray
from ..errors import CameraError
from .base import Camera, checked_size
from .distortion import FAR, first_positive_root
from .monotone import MonotoneInverse

_TABLE_SIZE = 1025


class PolynomialCamera(Camera):
    """Rays are `(x, y, g(rho))` with `g = a0 + a1 rho + a2 rho^2 + ...`, `rho = |(x, y)|`, z forward.

    A pixel is `centre + [[c, d], [e, 1]] (x, y)`, x to the right, y down. The model ends where
    the angle off the axis stops growing with rho.
    Source: method.md 1; Scaramuzza, Martinelli and Siegwart 2006.

    Parameters
    ----------
    width, height
        Size of the photo in pixels.
    centre
        (2,) pixel of the axis, (u, v) from the centre of the top-left pixel.
    coefficients
        a0, a1, a2, ... in powers of pixels; a0 > 0, since z points forward (OCamCalib's files have a0 < 0
        and other axes, see `files.read_ocamcalib`). A single a0 is the perspective camera of that
        focal length.
    stretch
        c, d, e of the affine matrix.

    Raises
    ------
    CameraError
        Parameters that make no sense.
    """

    def __init__(
        self,
        width: int,
        height: int,
        centre: ArrayLike,
        coefficients: ArrayLike,
        stretch: ArrayLike = (1.0, 0.0, 0.0),
    ):
        self.width, self.height = checked_size(width, height)
        self.centre = _numbers(centre, "centre", 2)
        self.coefficients = _numbers(coefficients, "coefficients", None)
        self.stretch = _numbers(stretch, "stretch", 3)
        if self.coefficients[0] <= 0:
            raise CameraError("The coefficient a0 must be positive: it is the focal length, with z forward.")
        c, d, e = self.stretch
        if c - d * e <= 0:
            raise CameraError("The stretch c, d, e must not mirror or flatten the image (c - d e > 0).")
        self._affine = np.array([[c, d], [e, 1.0]])

    @cached_property
    def limit(self) -> float:
        """Largest rho (pixels) at which the angle off the axis still grows."""
        a = np.array(self.coefficients)
        # The angle is atan2(rho, g): it grows while g - rho g' > 0, whose terms are (1 - i) a_i.
        return min(first_positive_root(a * (1 - np.arange(a.size))), float(FAR * a[0]))

    def lift(self, rho: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Polynomial g and its derivative: rho (...) pixels -> (...), (...)."""
        value, slope = np.zeros_like(rho), np.zeros_like(rho)
        for a in reversed(self.coefficients):
            slope = slope * rho + value
            value = value * rho + a
        return value, slope

    def _angle_with_slope(self, rho: FloatArray) -> tuple[FloatArray, FloatArray]:
        value, slope = self.lift(rho)
        return np.arctan2(rho, value), (value - rho * slope) / (rho * rho + value * value)

    @cached_property
    def _rho(self) -> MonotoneInverse:
        """Rho of an angle off the axis."""
        a0 = self.coefficients[0]
        nodes = a0 * np.tan(np.linspace(0, np.arctan(self.limit / a0), _TABLE_SIZE))
        nodes[-1] = self.limit * (1 - 1e-15)
        return MonotoneInverse(self._angle_with_slope, nodes)

    @property
    def field_angle(self) -> float:
        """Largest angle off the axis (rad)."""
        return self._rho.highest

    def project(self, points: ArrayLike) -> FloatArray:
        """Pixels of points: (N,3) camera frame -> (N,2), NaN rows where the model does not see the point."""
        points = np.asarray(points, dtype=np.float64)
        return self._to_pixels(points, *self._polar(points))

    def _polar(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distance from the axis and rho of points (...,3); NaN where not seen."""
        r = np.sqrt(points[..., 0] ** 2 + points[..., 1] ** 2)
        rho = self._rho(np.arctan2(r, points[..., 2]))
        return r, np.where((r == 0) & ~(points[..., 2] > 0), np.nan, rho)

    def _to_pixels(self, points: FloatArray, r: FloatArray, rho: FloatArray) -> FloatArray:
        gain = np.divide(rho, r, out=np.where(np.isnan(rho), np.nan, 0.0), where=r > 0)
        pixels: FloatArray = (points[..., :2] * gain[..., None]) @ self._affine.T + self.centre
        return pixels

    def project_with_jacobian(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Pixels of points and their derivative: (N,3) camera frame -> (N,2), (N,2,3); NaN rows outside."""
        points = np.asarray(points, dtype=np.float64)
        r, rho = self._polar(points)
        z = points[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            steep = 1 / (self._angle_with_slope(rho)[1] * (r * r + z * z))  # d rho / d angle / distance^2
            along = np.where((r > 0)[..., None], points[..., :2] / r[..., None], (1.0, 0.0))
            gain = np.where(r > 0, rho / r, self.coefficients[0] / z)
        gain = np.where(np.isnan(rho), np.nan, gain)
        plane = np.empty((*r.shape, 2, 3))
        plane[..., :2] = gain[..., None, None] * np.eye(2)
        plane[..., :2] += (steep * z - gain)[..., None, None] * (along[..., :, None] * along[..., None, :])
        plane[..., 2] = -(steep * r)[..., None] * along
        pixels = self._to_pixels(points, r, rho)
        jacobian = self._affine @ plane
        jacobian[np.isnan(rho)] = np.nan
        return pixels, jacobian

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Unit viewing rays of pixels: (N,2) -> (N,3) camera frame, NaN rows outside the model's field."""
        plane = (np.asarray(pixels, dtype=np.float64) - self.centre) @ np.linalg.inv(self._affine).T
        rho = np.hypot(plane[..., 0], plane[..., 1])
        rho = np.where(rho < self.limit, rho, np.nan)
        height = self.lift(rho)[0]
        rays: FloatArray = np.concatenate([plane, height[..., None]], axis=-1)
        rays /= np.hypot(rho, height)[..., None]
        return rays

    def _rescaled(self, width: int, height: int, sx: float, sy: float) -> Self:
        c, d, e = self.stretch
        centre = ((self.centre[0] + 0.5) * sx - 0.5, (self.centre[1] + 0.5) * sy - 0.5)
        # The matrix keeps its last entry 1, so lengths on the plane take the scale of v.
        coefficients = [a * sy ** (1 - i) for i, a in enumerate(self.coefficients)]
        return type(self)(width, height, centre, coefficients, (c * sx / sy, d * sx / sy, e))


def _numbers(values: ArrayLike, name: str, count: int | None) -> tuple[float, ...]:
    """Return a tuple of finite numbers, of the given count, or raise CameraError."""
    given = np.asarray(values, dtype=np.float64).ravel()
    if given.size == 0 or not np.all(np.isfinite(given)) or (count is not None and given.size != count):
        wanted = "some" if count is None else str(count)
        raise CameraError(f"The {name} of a polynomial camera must be {wanted} finite numbers.")
    return tuple(given.tolist())
