"""The perspective camera with Brown–Conrady distortion."""

from __future__ import annotations

from typing import Self

import numpy as np

from ..arrays import ArrayLike, FloatArray
from .distortion import Distortion
from .plane import PlaneCamera, PlaneJacobian

_NEAREST = 1e-150
"""Depths not above this count as behind the camera; it only keeps quotients finite."""


class PerspectiveCamera(PlaneCamera):
    """`x = K distort(X / Z, Y / Z)`: sees what lies in front of it (Z > 0) within the distortion's field.

    Parameters
    ----------
    width, height
        Size of the photo in pixels.
    K
        Camera matrix (3,3) in pixels, origin at the centre of the top-left pixel; skew K[0,1] is allowed.
    distortion
        OpenCV order k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 of any shorter length, or a `Distortion`.

    Raises
    ------
    CameraError
        Sizes, matrix or coefficients that make no sense.

    Source: method.md 1; OpenCV's camera model for the order of the coefficients.
    """

    def __init__(self, width: int, height: int, K: ArrayLike, distortion: ArrayLike | Distortion = ()):
        if not isinstance(distortion, Distortion):
            distortion = Distortion.from_opencv(distortion)
        super().__init__(width, height, K, distortion)

    def _to_plane(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        z = points[..., 2]
        inverse = np.divide(1.0, z, out=np.full(z.shape, np.nan), where=z > _NEAREST)
        return points[..., 0] * inverse, points[..., 1] * inverse

    def _to_plane_with_jacobian(self, points: FloatArray) -> tuple[FloatArray, FloatArray, PlaneJacobian]:
        z = points[..., 2]
        inverse = np.divide(1.0, z, out=np.full(z.shape, np.nan), where=z > _NEAREST)
        x, y = points[..., 0] * inverse, points[..., 1] * inverse
        zero = np.where(np.isnan(inverse), np.nan, 0.0)
        return x, y, ((inverse, zero, -x * inverse), (zero, inverse, -y * inverse))

    def _from_plane(self, x: FloatArray, y: FloatArray) -> FloatArray:
        z = 1 / np.sqrt(x * x + y * y + 1)
        return np.stack([x * z, y * z, z], axis=-1)

    def _with_matrix(self, width: int, height: int, K: FloatArray) -> Self:
        return type(self)(width, height, K, self.distortion)
