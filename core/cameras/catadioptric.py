"""The unified sphere camera: mirrors in front of a lens, and wide lenses."""

from __future__ import annotations

from typing import Self

import numpy as np

from ..arrays import ArrayLike, FloatArray
from ..errors import CameraError
from .distortion import Distortion
from .plane import PlaneCamera


class CatadioptricCamera(PlaneCamera):
    """Unified sphere: a point goes to the unit sphere and is seen from xi behind its centre.

    `x = K distort((X, Y) / (Z + xi d))` with d = |(X, Y, Z)|. Sees directions with `Z > -xi d` (xi <= 1) or
    `Z > -d / xi` (xi > 1), where the map is one to one; xi = 0 is perspective, xi = 1 para-catadioptric.

    Parameters
    ----------
    width, height
        Size of the photo in pixels.
    K
        Camera matrix (3,3) in pixels, origin at the centre of the top-left pixel; skew K[0,1] is allowed.
    xi
        Distance of the second centre from the sphere's, >= 0.
    distortion
        Mei's k1, k2, p1, p2 on the plane (OpenCV's order, longer vectors too), or a `Distortion`.

    Raises
    ------
    CameraError
        Sizes, matrix, xi or coefficients that make no sense.

    Source: method.md 1 (Geyer and Daniilidis 2000; Barreto and Araujo 2001); Mei and Rives 2007.
    """

    def __init__(
        self, width: int, height: int, K: ArrayLike, xi: float, distortion: ArrayLike | Distortion = ()
    ):
        super().__init__(width, height, K, distortion)
        if not (np.isfinite(xi) and xi >= 0):
            raise CameraError(f"The mirror parameter xi must be a number of at least 0, not {xi}.")
        self.xi = float(xi)
        self._lowest = -min(self.xi, 1 / self.xi) if self.xi > 0 else 0.0

    def _gain(self, points: FloatArray) -> FloatArray:
        z = points[..., 2]
        distance = np.sqrt(points[..., 0] ** 2 + points[..., 1] ** 2 + z * z)
        depth = z + self.xi * distance
        seen = (z > self._lowest * distance) & (depth > 0)
        return np.divide(1.0, depth, out=np.full(z.shape, np.nan), where=seen)

    def _gain_with_slopes(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        gain = self._gain(points)
        z = points[..., 2]
        distance = np.sqrt(points[..., 0] ** 2 + points[..., 1] ** 2 + z * z)
        pull = np.divide(self.xi, distance, out=np.zeros(z.shape), where=distance > 0)
        return gain, -0.5 * pull * gain * gain, -(1 + pull * z) * gain * gain

    def _from_plane(self, x: FloatArray, y: FloatArray) -> FloatArray:
        r2 = x * x + y * y
        under = 1 + (1 - self.xi**2) * r2
        root = np.sqrt(under, out=np.full(r2.shape, np.nan), where=under >= 0)
        eta = (self.xi + root) / (1 + r2)
        # z = eta - xi, written without the difference of nearly equal numbers.
        z = (root - self.xi * r2) / (1 + r2)
        return np.stack([x * eta, y * eta, z], axis=-1)

    def _with_matrix(self, width: int, height: int, K: FloatArray) -> Self:
        return type(self)(width, height, K, self.xi, self.distortion)
