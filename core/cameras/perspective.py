"""The perspective camera with Brown–Conrady distortion."""

from __future__ import annotations

from typing import Self

import numpy as np

from ..arrays import FloatArray
from .plane import PlaneCamera

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

    def _gain(self, points: FloatArray) -> FloatArray:
        z = points[..., 2]
        return np.divide(1.0, z, out=np.full(z.shape, np.nan), where=z > _NEAREST)

    def _gain_with_slopes(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        gain = self._gain(points)
        return gain, np.zeros_like(gain), -gain * gain

    def _from_plane(self, x: FloatArray, y: FloatArray) -> FloatArray:
        z = 1 / np.sqrt(x * x + y * y + 1)
        return np.stack([x * z, y * z, z], axis=-1)

    def _with_matrix(self, width: int, height: int, K: FloatArray) -> Self:
        return type(self)(width, height, K, self.distortion)
