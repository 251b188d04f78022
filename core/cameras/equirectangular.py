"""The equirectangular camera: 360 degree panoramas, whole or cropped."""

from __future__ import annotations

from typing import Self

import numpy as np

from ..arrays import ArrayLike, FloatArray
from ..errors import CameraError
from .base import Camera, checked_size


class EquirectangularCamera(Camera):
    """Longitude runs with u, latitude with v: the middle of a whole panorama looks along z, its top is up.

    `u = W (1/2 + atan2(X, Z) / 2 pi) - 1/2` and `v = H (1/2 + atan2(Y, |(X, Z)|) / pi) - 1/2`, less the
    offset of a crop. Every direction is seen. `project` gives the u inside the turn centred on the frame,
    [-1/2, W - 1/2] for a whole panorama; `unproject` takes any u, and is NaN only beyond the poles. The rows
    v = -1/2 and v = H - 1/2 are one direction each, where the derivative does not exist (NaN).

    Parameters
    ----------
    width, height
        Size of the photo in pixels.
    full_size
        Size (W, H) of the whole panorama that the photo was cropped from; (width, height) when left out.
        Fractions are allowed (a panorama resized by any factor).
    offset
        Left and upper margin of the crop in the whole panorama, pixels.

    Raises
    ------
    CameraError
        Sizes that make no sense, or a crop that reaches out of its panorama.
    """

    def __init__(
        self,
        width: int,
        height: int,
        full_size: tuple[float, float] | None = None,
        offset: tuple[float, float] = (0.0, 0.0),
    ):
        self.width, self.height = checked_size(width, height)
        self.full_size = (float(self.width), float(self.height)) if full_size is None else _pair(full_size)
        self.offset = _pair(offset)
        if min(self.full_size) <= 0:
            raise CameraError("The whole panorama must have a positive size.")
        # A photo resized by any factor has a rounded size, so a little more than the whole is allowed.
        if self.width > 1.01 * self.full_size[0] + 1 or self.height > 1.01 * self.full_size[1] + 1:
            raise CameraError("The photo is larger than the whole panorama it is said to be a part of.")

    @property
    def turn(self) -> float:
        """Pixels of a full turn: u and u + turn are the same direction."""
        return self.full_size[0]

    @property
    def is_whole(self) -> bool:
        """Whether the photo is a whole panorama, not a crop."""
        return self.full_size == (float(self.width), float(self.height)) and not any(self.offset)

    def unwrapped(self, pixels: ArrayLike, reference: ArrayLike) -> FloatArray:
        """Pixels (...,2) shifted by whole turns to lie nearest to `reference` (...,2)."""
        out = np.array(pixels, dtype=np.float64)
        difference = out[..., 0] - np.asarray(reference, dtype=np.float64)[..., 0]
        out[..., 0] -= self.turn * np.round(difference / self.turn)
        return out

    def project(self, points: ArrayLike) -> FloatArray:
        """Pixels of points: (N,3) camera frame -> (N,2), NaN rows at the camera centre itself."""
        points = np.asarray(points, dtype=np.float64)
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        horizontal = np.hypot(x, z)
        longitude, latitude = np.arctan2(x, z), np.arctan2(y, horizontal)
        pixels = np.empty((*x.shape, 2))
        pixels[..., 0] = self.turn * (0.5 + longitude / (2 * np.pi)) - 0.5 - self.offset[0]
        pixels[..., 1] = self.full_size[1] * (0.5 + latitude / np.pi) - 0.5 - self.offset[1]
        pixels[(horizontal == 0) & (y == 0)] = np.nan
        if self.full_size[0] != self.width or self.offset[0] != 0:
            pixels = self.unwrapped(pixels, (self.width / 2 - 0.5, 0.0))
        return pixels

    def project_with_jacobian(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Pixels of points and their derivative: (N,3) camera frame -> (N,2), (N,2,3); NaN at the poles."""
        points = np.asarray(points, dtype=np.float64)
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        across2 = x * x + z * z
        across = np.sqrt(across2)
        per_longitude, per_latitude = self.turn / (2 * np.pi), self.full_size[1] / np.pi
        jacobian = np.zeros((*x.shape, 2, 3))
        with np.errstate(divide="ignore", invalid="ignore"):
            jacobian[..., 0, 0] = per_longitude * z / across2
            jacobian[..., 0, 2] = -per_longitude * x / across2
            inverse = per_latitude / (across2 + y * y)
            jacobian[..., 1, 0] = -inverse * x * y / across
            jacobian[..., 1, 1] = inverse * across
            jacobian[..., 1, 2] = -inverse * z * y / across
        jacobian[~(across > 0)] = np.nan
        return self.project(points), jacobian

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Unit viewing rays of pixels: (N,2) -> (N,3) camera frame, NaN rows beyond the poles."""
        pixels = np.asarray(pixels, dtype=np.float64)
        u = (pixels[..., 0] + self.offset[0] + 0.5) / self.turn - 0.5
        v = (pixels[..., 1] + self.offset[1] + 0.5) / self.full_size[1] - 0.5
        longitude = 2 * np.pi * u
        latitude = np.pi * np.where(np.abs(v) <= 0.5, v, np.nan)
        flat = np.cos(latitude)
        return np.stack([flat * np.sin(longitude), np.sin(latitude), flat * np.cos(longitude)], axis=-1)

    def _rescaled(self, width: int, height: int, sx: float, sy: float) -> Self:
        full = (self.full_size[0] * sx, self.full_size[1] * sy)
        return type(self)(width, height, full, (self.offset[0] * sx, self.offset[1] * sy))


def _pair(values: tuple[float, float]) -> tuple[float, float]:
    """Return two finite numbers or raise CameraError."""
    given = np.asarray(values, dtype=np.float64)
    if given.shape != (2,) or not np.all(np.isfinite(given)):
        raise CameraError("The size and the offset of a cropped panorama are two numbers each.")
    return float(given[0]), float(given[1])
