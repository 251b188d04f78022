"""A region of a photo: a patch with sharp outline, as a mask or a polygon with holes.

Pixels are (u, v); the centre of the top-left pixel is (0, 0), so pixel (u, v) spans u ± 0.5, v ± 0.5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ..arrays import ArrayLike, BoolArray, FloatArray
from ..errors import RegionError
from ..geometry.outlines import fill_loops, loop_area, mask_loops


@dataclass(frozen=True, eq=False)
class ImageRegion:
    """A region by its outline: closed loops (n,2) of pixels, positive shoelace area around filled parts.

    `frame` is (width, height) of the mask it came from, or None for a polygon. `hidden` (H,W) marks pixels
    where the true outline is not seen (something stands before it): it does not count there.
    Make one with `from_mask` or `from_polygon`.
    """

    loops: tuple[FloatArray, ...]
    name: str = ""
    frame: tuple[int, int] | None = None
    hidden: BoolArray | None = None

    @classmethod
    def from_mask(cls, mask: ArrayLike, name: str = "", hidden: ArrayLike | None = None) -> ImageRegion:
        """Region of the true pixels of a mask (H,W); its outline runs between pixels.

        `hidden` (H,W) marks pixels where the outline is unknown.

        Raises
        ------
        RegionError
            The mask is empty or not two-dimensional, or `hidden` has another size.
        """
        pixels = _as_mask(mask, name)
        height, width = pixels.shape
        u, v, columns, rows = cv2.boundingRect(pixels.view(np.uint8))
        if columns == 0:
            raise RegionError(f"{described(name)} is empty: mark at least its outline in the photo.")
        loops = mask_loops(pixels[v : v + rows, u : u + columns])
        unknown = None if hidden is None else _as_mask(hidden, name)
        if unknown is not None and unknown.shape != pixels.shape:
            raise RegionError(f"The hidden part of {described(name)} has another size than its mask.")
        return cls(tuple(loop + np.array([u, v]) for loop in loops), name, (width, height), unknown)

    @classmethod
    def from_polygon(cls, outline: ArrayLike, holes: Sequence[ArrayLike] = (), name: str = "") -> ImageRegion:
        """Region inside a polygon (n,2) of pixel coordinates, without its `holes`, each (n,2).

        Raises
        ------
        RegionError
            A polygon with fewer than three corners, without area, or with coordinates that are no numbers.
        """
        loops = [_oriented(outline, 1.0, name), *(_oriented(hole, -1.0, name) for hole in holes)]
        return cls(tuple(loops), name)

    @property
    def area(self) -> float:
        """Area in square pixels."""
        return loop_area(self.loops)

    def to_mask(self, width: int, height: int) -> BoolArray:
        """Mask (height, width) of the pixels whose centres lie in the region."""
        return fill_loops(self.loops, width, height)


def described(name: str) -> str:
    """How a message speaks of a region."""
    return f"Region '{name}'" if name else "The region"


def _as_mask(mask: ArrayLike, name: str) -> BoolArray:
    pixels = np.asarray(mask)
    if pixels.ndim != 2:
        raise RegionError(
            f"{described(name)}: a mask has one value per pixel, not an array of shape {pixels.shape}."
        )
    if pixels.dtype != np.bool_:
        pixels = pixels != 0
    return np.ascontiguousarray(pixels)


def _oriented(polygon: ArrayLike, sign: float, name: str) -> FloatArray:
    """Polygon (n,2) with the wanted sign of its area."""
    points = np.array(polygon, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
        raise RegionError(f"{described(name)}: an outline needs at least three (u, v) corners.")
    if not np.all(np.isfinite(points)):
        raise RegionError(f"{described(name)}: the outline has coordinates that are not numbers.")
    area = loop_area([points])
    if area == 0:
        raise RegionError(f"{described(name)}: the outline encloses no area.")
    return points if area * sign > 0 else points[::-1].copy()
