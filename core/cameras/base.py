"""What every central camera can do.

Pixels are (u, v), u right, v down; the centre of the top-left pixel is (0, 0), so a frame of width w spans
-0.5 <= u <= w - 0.5. The camera frame has x right, y down, z forward.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self

import numpy as np

from ..arrays import ArrayLike, BoolArray, FloatArray
from ..errors import CameraError


class Camera(ABC):
    """A central camera: a map between pixels and unit viewing rays. Cameras are never changed once made."""

    width: int
    height: int

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.width} x {self.height})"

    @abstractmethod
    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Unit viewing rays of pixels: (N,2) -> (N,3) camera frame, NaN rows outside the model's field."""

    @abstractmethod
    def project_with_jacobian(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Pixels of points and their derivative: (N,3) camera frame -> (N,2), (N,2,3); NaN rows outside."""

    def project(self, points: ArrayLike) -> FloatArray:
        """Pixels of points: (N,3) camera frame -> (N,2), NaN rows where the model does not see the point.

        A point outside the frame but inside the model's field keeps its (finite) pixel; see `in_frame`.
        """
        return self.project_with_jacobian(points)[0]

    def unwrapped(self, pixels: ArrayLike, reference: ArrayLike) -> FloatArray:
        """Pixels (...,2) of the same directions that lie nearest to `reference` (...,2).

        Only a panorama has a seam to unwrap; other cameras return the pixels as they are.
        """
        return np.array(pixels, dtype=np.float64)

    def scaled(self, factor: float) -> Self:
        """Return the camera of the same photo resized by `factor` (0.5: half as wide and high).

        Pixels become `(pixel + 0.5) * factor - 0.5`; the new size is rounded to whole pixels.
        """
        if not (np.isfinite(factor) and factor > 0):
            raise CameraError(f"A photo can be scaled by a positive factor only, not by {factor}.")
        width, height = max(1, round(self.width * factor)), max(1, round(self.height * factor))
        return self._rescaled(width, height, factor, factor)

    def resized(self, width: int, height: int) -> Self:
        """Return the camera of the same photo resized to exactly `width` x `height` pixels."""
        width, height = checked_size(width, height)
        return self._rescaled(width, height, width / self.width, height / self.height)

    @abstractmethod
    def _rescaled(self, width: int, height: int, sx: float, sy: float) -> Self:
        """Return the camera with pixels `(u + 0.5) sx - 0.5`, `(v + 0.5) sy - 0.5` and the given size."""

    def in_frame(self, pixels: ArrayLike, margin: float = 0.0) -> BoolArray:
        """Whether pixels lie in the photo, at least `margin` pixels from its edge: (N,2) -> (N,)."""
        pixels = np.asarray(pixels, dtype=np.float64)
        u, v = pixels[..., 0], pixels[..., 1]
        inside: BoolArray = (
            (u >= margin - 0.5)
            & (u <= self.width - 0.5 - margin)
            & (v >= margin - 0.5)
            & (v <= self.height - 0.5 - margin)
        )
        return inside


def checked_size(width: int, height: int) -> tuple[int, int]:
    """Frame size as whole numbers, or CameraError."""
    if int(width) != width or int(height) != height or width < 1 or height < 1:
        raise CameraError(f"A photo has a whole number of pixels, not {width} x {height}.")
    return int(width), int(height)
