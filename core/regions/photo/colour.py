"""Growing regions of like colour from a click, in CIELAB, stopping at edges."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import BoolArray, Float32Array, FloatArray
from .edges import Gradient, to_full, to_reduced
from .outline import smoothed_mask, without_holes

_REDUCED = 0.5  # size relative to the working copy: a region of like colour shows there as well
_SEED_RADIUS = 1  # pixels around the click whose colours make the seed
_EDGE_WEIGHT = 60.0  # colour distance (Delta E) that a unit of evened gradient counts for
_TOLERANCES = np.geomspace(1.5, 60.0, 14)  # Delta E
_MARGIN = 6  # pixels around a region that smoothing its outline looks at
_LEAST = 30  # pixels: smaller regions are the click's own surroundings


@dataclass(frozen=True, eq=False)
class ColourMap:
    """CIELAB (h,w,3) of a photo at half its working size, and what its edges count for (h,w) in Delta E."""

    colours: Float32Array
    edge: Float32Array


def colour_map(colours: Float32Array, edges: Gradient) -> ColourMap:
    """Make CIELAB colours (H,W,3) and their gradient ready for growing."""
    size = round(colours.shape[1] * _REDUCED), round(colours.shape[0] * _REDUCED)
    small = cv2.resize(colours, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    strongest = cv2.dilate(cv2.magnitude(edges.u, edges.v), np.ones((2, 2), np.uint8))
    edge = _EDGE_WEIGHT * cv2.resize(strongest, size, interpolation=cv2.INTER_NEAREST)
    return ColourMap(small, edge.astype(np.float32))


def grown_loops(ground: ColourMap, point: FloatArray) -> list[FloatArray]:
    """Outlines (n,2) in working pixels of the regions around a point (2,) for growing tolerances."""
    distance, seed = _distance(ground, point)
    loops = []
    area = 0
    for tolerance in _TOLERANCES:
        mask, corner = _joined(distance, seed, float(tolerance))
        count = int(np.count_nonzero(mask))
        if count >= max(_LEAST, 1.02 * area):
            loops.append(_outline(mask, corner))
            area = count
    return loops


def grown_loop(ground: ColourMap, point: FloatArray, tolerance: float) -> FloatArray:
    """Outline (n,2) in working pixels of the region around a point (2,) for one tolerance (Delta E)."""
    distance, seed = _distance(ground, point)
    return _outline(*_joined(distance, seed, tolerance))


def _distance(ground: ColourMap, point: FloatArray) -> tuple[Float32Array, tuple[int, int]]:
    """How unlike (h,w) every pixel is to the point's surroundings, in Delta E, edges raised; and its pixel.

    Lightness counts half as much as hue and chroma: shade falls across one wall. The seed's own scatter is
    taken off, so that a rough surface grows as easily as a smooth one.
    """
    height, width = ground.edge.shape
    place = np.round(to_reduced(point, _REDUCED)).astype(int)
    u, v = int(np.clip(place[0], 0, width - 1)), int(np.clip(place[1], 0, height - 1))
    weight = np.array([0.5, 1.0, 1.0], dtype=np.float32)
    patch = ground.colours[
        max(v - _SEED_RADIUS, 0) : v + _SEED_RADIUS + 1, max(u - _SEED_RADIUS, 0) : u + _SEED_RADIUS + 1
    ].reshape(-1, 3)
    seed = np.median(patch, axis=0)
    scatter = float(np.median(np.linalg.norm((patch - seed) * weight, axis=1)))
    light, green, blue = cv2.split((ground.colours - seed) * weight)
    unlike = cv2.magnitude(cv2.magnitude(light, green), blue) - scatter
    return np.maximum(unlike, ground.edge).astype(np.float32), (u, v)


def _joined(
    distance: Float32Array, seed: tuple[int, int], tolerance: float
) -> tuple[BoolArray, tuple[int, int]]:
    """Pixels joined to the seed over distances of at most `tolerance`, holes filled.

    As the mask of a window around them, and the pixel (u, v) of its top-left corner.
    """
    u, v = seed
    barred = np.pad((distance > tolerance).view(np.uint8), 1, constant_values=1)
    barred[max(v, 1) : v + 3, max(u, 1) : u + 3] = 0
    barred[[0, -1]] = barred[:, [0, -1]] = 1
    flags = 4 | (2 << 8) | cv2.FLOODFILL_MASK_ONLY
    even = np.zeros_like(distance, np.uint8)  # only the bars stop the flood
    left, top, columns, rows = cv2.floodFill(even, barred, (u, v), (1,), flags=flags)[3]
    corner = max(left - _MARGIN, 0), max(top - _MARGIN, 0)
    window = np.s_[corner[1] : top + rows + _MARGIN, corner[0] : left + columns + _MARGIN]
    inside = (barred[1:-1, 1:-1][window] == 2).view(np.uint8)
    inside = cv2.dilate(inside, np.ones((3, 3), np.uint8))  # up to the middle of the edge
    return without_holes(inside > 0), corner


def _outline(mask: BoolArray, corner: tuple[int, int]) -> FloatArray:
    smooth = smoothed_mask(mask, 1.0)
    shape = smooth if smooth.any() else mask
    # Every pixel as two by two: contours run through the middle of pixels, here a quarter off the border.
    finer = np.repeat(np.repeat(shape, 2, axis=0), 2, axis=1)
    loops, _ = cv2.findContours(finer.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest = cv2.approxPolyDP(max(loops, key=cv2.contourArea), 1.0, True)[:, 0].astype(np.float64)
    return to_full((largest + 0.5) / 2 - 0.5 + np.array(corner), _REDUCED)
