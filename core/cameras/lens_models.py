"""Further lens models of one or two parameters, with which other programs calibrate."""

from __future__ import annotations

from typing import Self

import numpy as np

from ..arrays import ArrayLike, FloatArray
from ..errors import CameraError
from .distortion import FAR, first_fold
from .monotone import MonotoneInverse
from .plane import PlaneCamera

_TABLE_SIZE = 513


class ExtendedUnifiedCamera(PlaneCamera):
    """Extended unified model: `x = K (X, Y) / (alpha sqrt(beta (X^2 + Y^2) + Z^2) + (1 - alpha) Z)`.

    `alpha` in [0, 1], `beta` > 0. Alpha = beta = 1 is the orthographic fisheye.
    Source: Khomutenko, Garcia and Martinet 2016.
    """

    def __init__(self, width: int, height: int, K: ArrayLike, alpha: float, beta: float):
        super().__init__(width, height, K)
        if not (0 <= alpha <= 1 and np.isfinite(beta) and beta > 0):
            raise CameraError(f"alpha must lie in 0..1 and beta above 0, not {alpha} and {beta}.")
        self.alpha, self.beta = float(alpha), float(beta)
        smaller, larger = sorted((self.alpha, 1 - self.alpha))
        self._lowest = -smaller / larger

    def _gain(self, points: FloatArray) -> FloatArray:
        z = points[..., 2]
        distance = np.sqrt(self.beta * (points[..., 0] ** 2 + points[..., 1] ** 2) + z * z)
        depth = self.alpha * distance + (1 - self.alpha) * z
        seen = (z > self._lowest * distance) & (depth > 0)
        return np.divide(1.0, depth, out=np.full(z.shape, np.nan), where=seen)

    def _gain_with_slopes(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        gain = self._gain(points)
        z = points[..., 2]
        distance = np.sqrt(self.beta * (points[..., 0] ** 2 + points[..., 1] ** 2) + z * z)
        pull = np.divide(self.alpha, distance, out=np.zeros(z.shape), where=distance > 0)
        return gain, -0.5 * self.beta * pull * gain * gain, -(1 - self.alpha + pull * z) * gain * gain

    def _from_plane(self, x: FloatArray, y: FloatArray) -> FloatArray:
        a, r2 = self.alpha, x * x + y * y
        under = 1 - (2 * a - 1) * self.beta * r2
        root = np.sqrt(under, out=np.full(r2.shape, np.nan), where=under >= 0)
        z = (1 - a * a * self.beta * r2) / (a * root + 1 - a)
        return _unit(x, y, z)

    def _with_matrix(self, width: int, height: int, K: FloatArray) -> Self:
        return type(self)(width, height, K, self.alpha, self.beta)


class DivisionCamera(PlaneCamera):
    """Division model: the ray of a plane point m is `(m, 1 + k |m|^2)`. Source: Fitzgibbon 2001.

    Barrel distortion (k < 0) sees every direction but straight back; k > 0 ends at `tan = 1 / (2 sqrt(k))`.
    """

    def __init__(self, width: int, height: int, K: ArrayLike, k: float):
        super().__init__(width, height, K)
        if not np.isfinite(k):
            raise CameraError("The coefficient k of a division camera must be a finite number.")
        self.k = float(k)

    def _root(self, points: FloatArray) -> FloatArray:
        z = points[..., 2]
        under = z * z - 4 * self.k * (points[..., 0] ** 2 + points[..., 1] ** 2)
        seen = (under > 0) & ((z > 0) | (self.k < 0))
        root: FloatArray = np.sqrt(under, out=np.full(z.shape, np.nan), where=seen)
        return root

    def _gain(self, points: FloatArray) -> FloatArray:
        z = points[..., 2]
        root = self._root(points)
        s = points[..., 0] ** 2 + points[..., 1] ** 2
        depth = np.full(z.shape, np.nan)
        np.add(z, root, out=depth, where=z >= 0)
        # Behind the camera z + root cancels: the same as a quotient.
        np.divide(-4 * self.k * s, root - z, out=depth, where=(z < 0) & (s > 0))
        return 2 / depth

    def _gain_with_slopes(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        gain, root = self._gain(points), self._root(points)
        # With depth = 2 / gain = z + root: d depth / ds = -2 k / root, d depth / dz = depth / root.
        return gain, self.k * gain * gain / root, -gain / root

    def _from_plane(self, x: FloatArray, y: FloatArray) -> FloatArray:
        r2 = x * x + y * y
        seen = r2 * self.k < 1  # beyond it a positive k folds back
        return _unit(x, y, np.where(seen, 1 + self.k * r2, np.nan))

    def _with_matrix(self, width: int, height: int, K: FloatArray) -> Self:
        return type(self)(width, height, K, self.k)


class FieldOfViewCamera(PlaneCamera):
    """FOV model: `rho = atan(2 tan(omega / 2) r / Z) / omega`, in front of the camera only.

    `omega` (rad) in (0, pi). Source: Devernay and Faugeras 2001.
    """

    def __init__(self, width: int, height: int, K: ArrayLike, omega: float):
        super().__init__(width, height, K)
        if not 0 < omega < np.pi:
            raise CameraError(f"The angle omega of a FOV camera must lie between 0 and pi, not {omega}.")
        self.omega = float(omega)
        self._stretch = 2 * float(np.tan(self.omega / 2))

    def _gain(self, points: FloatArray) -> FloatArray:
        z = points[..., 2]
        r = np.sqrt(points[..., 0] ** 2 + points[..., 1] ** 2)
        front = z > 0
        axial = np.divide(self._stretch / self.omega, z, out=np.full(z.shape, np.nan), where=front)
        return np.divide(np.arctan2(self._stretch * r, z) / self.omega, r, out=axial, where=front & (r > 0))

    def _gain_with_slopes(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        gain = self._gain(points)
        z = points[..., 2]
        s = points[..., 0] ** 2 + points[..., 1] ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = self._stretch / self.omega / (self._stretch**2 * s + z * z)
        slope = np.where(np.isnan(gain), np.nan, slope)
        slope_s = np.divide(slope * z - gain, 2 * s, out=np.zeros(z.shape), where=s > 0)
        return gain, slope_s, -slope

    def _from_plane(self, x: FloatArray, y: FloatArray) -> FloatArray:
        rho = np.hypot(x, y)
        angle = rho * self.omega
        axial = np.full(rho.shape, self.omega)
        side = np.divide(np.sin(angle), rho, out=axial, where=rho > 0)
        z = np.where(angle < np.pi / 2, np.cos(angle) * self._stretch, np.nan)
        return _unit(x * side, y * side, z)

    def _with_matrix(self, width: int, height: int, K: FloatArray) -> Self:
        return type(self)(width, height, K, self.omega)


class InverseRadialCamera(PlaneCamera):
    """Radial distortion told from the photo: the ray of a plane point m is `(m (1 + k |m|^2), 1)`.

    Perspective, in front of the camera only; a negative k ends where it folds. Source: VisualSFM's camera.
    """

    def __init__(self, width: int, height: int, K: ArrayLike, k: float):
        super().__init__(width, height, K)
        if not np.isfinite(k):
            raise CameraError("The coefficient k of an inverse radial camera must be a finite number.")
        self.k = float(k)
        self._limit = min(first_fold((self.k,), ()), FAR)
        nodes = np.tan(np.linspace(0, np.arctan(self._limit * (1 - 1e-15)), _TABLE_SIZE))
        self._seen_radius = MonotoneInverse(_Cubic(self.k), nodes)

    def _gain(self, points: FloatArray) -> FloatArray:
        return self._gain_with_slopes(points)[0]

    def _gain_with_slopes(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        z = points[..., 2]
        s = points[..., 0] ** 2 + points[..., 1] ** 2
        inverse = np.divide(1.0, z, out=np.full(z.shape, np.nan), where=z > 0)
        r = np.sqrt(s)
        m = self._seen_radius(r * inverse)
        gain = np.divide(m, r, out=np.where(np.isnan(m), np.nan, inverse), where=r > 0)
        slope = inverse / (1 + 3 * self.k * m * m)  # of m by r, and by z it is -r/z times that
        slope_s = np.divide(slope - gain, 2 * s, out=np.zeros(z.shape), where=s > 0)
        return gain, slope_s, -slope * inverse

    def _from_plane(self, x: FloatArray, y: FloatArray) -> FloatArray:
        r2 = x * x + y * y
        stretch = np.where(r2 < self._limit**2, 1 + self.k * r2, np.nan)
        return _unit(x * stretch, y * stretch, np.where(np.isnan(stretch), np.nan, 1.0))

    def _with_matrix(self, width: int, height: int, K: FloatArray) -> Self:
        return type(self)(width, height, K, self.k)


class _Cubic:
    """r + k r^3 with its slope."""

    def __init__(self, k: float):
        self._k = k

    def __call__(self, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        return r + self._k * r**3, 1 + 3 * self._k * r * r


def _unit(x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    """Unit vectors along (x, y, z), (...) each -> (...,3); NaN rows where z is NaN."""
    rays = np.stack([x, y, z], axis=-1)
    rays /= np.sqrt(x * x + y * y + z * z)[..., None]
    return rays
