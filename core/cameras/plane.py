"""Cameras that see through a normalised plane: direction -> plane -> distortion -> affine map K -> pixel."""

from __future__ import annotations

from abc import abstractmethod
from typing import Self

import numpy as np

from ..arrays import ArrayLike, FloatArray
from ..errors import CameraError
from .base import Camera, checked_size
from .distortion import Distortion


class PlaneCamera(Camera):
    """A camera that sends (X, Y, Z) to `x = X g, y = Y g` on a plane, distorts it and applies `K (x, y, 1)`.

    The gain g depends on X^2 + Y^2 and Z only; subclasses say how, and where it ends. `K` (3,3) is upper
    triangular with last row 0, 0, 1; pixels count from the centre of the top-left one.
    """

    K: FloatArray
    distortion: Distortion

    def __init__(self, width: int, height: int, K: ArrayLike, distortion: ArrayLike | Distortion = ()):
        self.width, self.height = checked_size(width, height)
        self.K = _checked_matrix(K)
        self.distortion = (
            distortion if isinstance(distortion, Distortion) else Distortion.from_opencv(distortion)
        )

    @abstractmethod
    def _gain(self, points: FloatArray) -> FloatArray:
        """Gain g (...) of points (...,3), NaN where the model does not see them."""

    @abstractmethod
    def _gain_with_slopes(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The gain (...) and its derivatives by X^2 + Y^2 and by Z."""

    @abstractmethod
    def _from_plane(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Points of the undistorted plane to unit rays: (...), (...) -> (...,3), NaN outside the field."""

    @abstractmethod
    def _with_matrix(self, width: int, height: int, K: FloatArray) -> Self:
        """Return the same lens with another frame and matrix."""

    def project(self, points: ArrayLike) -> FloatArray:
        """Pixels of points: (N,3) camera frame -> (N,2), NaN rows where the model does not see the point."""
        points = np.asarray(points, dtype=np.float64)
        gain = self._gain(points)
        return self._plane_to_pixels(points[..., 0] * gain, points[..., 1] * gain)

    def _plane_to_pixels(self, x: FloatArray, y: FloatArray) -> FloatArray:
        if not self.distortion.is_zero:
            x, y = self.distortion.apply(x, y)
        (fx, skew, cx), (_, fy, cy) = self.K[0], self.K[1]
        pixels = np.empty((*x.shape, 2))
        np.multiply(x, fx, out=pixels[..., 0])
        np.multiply(y, fy, out=pixels[..., 1])
        if skew != 0:
            pixels[..., 0] += skew * y
        pixels += (cx, cy)
        return pixels

    def project_with_jacobian(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Pixels of points and their derivative: (N,3) camera frame -> (N,2), (N,2,3); NaN rows outside."""
        points = np.asarray(points, dtype=np.float64)
        big_x, big_y = points[..., 0], points[..., 1]
        gain, slope_s, slope_z = self._gain_with_slopes(points)
        x, y = big_x * gain, big_y * gain
        mixed = 2 * big_x * big_y * slope_s
        dx = (gain + 2 * big_x * big_x * slope_s, mixed, big_x * slope_z)
        dy = (mixed, gain + 2 * big_y * big_y * slope_s, big_y * slope_z)
        jacobian = np.empty((*x.shape, 2, 3))
        (fx, skew, _), (_, fy, _) = self.K[0], self.K[1]
        if self.distortion.is_zero:
            for axis in range(3):
                jacobian[..., 0, axis] = fx * dx[axis] + skew * dy[axis]
                jacobian[..., 1, axis] = fy * dy[axis]
        else:
            a, b, c, d = self.distortion.jacobian(x, y)
            a, b, c, d = fx * a + skew * c, fx * b + skew * d, fy * c, fy * d
            for axis in range(3):
                jacobian[..., 0, axis] = a * dx[axis] + b * dy[axis]
                jacobian[..., 1, axis] = c * dx[axis] + d * dy[axis]
        pixels = self._plane_to_pixels(x, y)
        unseen = np.isnan(pixels[..., 0])
        if unseen.any():
            jacobian[unseen] = np.nan
        return pixels, jacobian

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Unit viewing rays of pixels: (N,2) -> (N,3) camera frame, NaN rows outside the model's field."""
        pixels = np.asarray(pixels, dtype=np.float64)
        (fx, skew, cx), (_, fy, cy) = self.K[0], self.K[1]
        y = (pixels[..., 1] - cy) / fy
        x = (pixels[..., 0] - cx - skew * y) / fx
        if not self.distortion.is_zero:
            x, y = self.distortion.undo(x, y)
        return self._from_plane(x, y)

    def _rescaled(self, width: int, height: int, sx: float, sy: float) -> Self:
        K = np.diag([sx, sy, 1.0]) @ self.K
        # Corners of the frame stay corners: u + 0.5 is what scales.
        K[0, 2], K[1, 2] = (self.K[0, 2] + 0.5) * sx - 0.5, (self.K[1, 2] + 0.5) * sy - 0.5
        return self._with_matrix(width, height, K)


def _checked_matrix(K: ArrayLike) -> FloatArray:
    """Return a private copy of a camera matrix, or raise CameraError saying what is wrong with it."""
    matrix = np.array(K, dtype=np.float64)
    if matrix.shape != (3, 3) or not np.all(np.isfinite(matrix)):
        raise CameraError("The camera matrix K must be 3 x 3 finite numbers.")
    if not np.array_equal(matrix[2], (0.0, 0.0, 1.0)) or matrix[1, 0] != 0:
        raise CameraError("The camera matrix K must have the form [[fx, s, cx], [0, fy, cy], [0, 0, 1]].")
    if matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise CameraError("The focal lengths fx and fy in the camera matrix K must be positive.")
    matrix.setflags(write=False)
    return matrix
