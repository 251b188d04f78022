"""Mending masks and turning them into polygons and back.

Pixels are (u, v); the centre of the top-left pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from ...arrays import ArrayLike, BoolArray, FloatArray
from ...errors import RegionError
from ...geometry.outlines import fill_loops, mask_loops


def without_holes(mask: BoolArray) -> BoolArray:
    """Mask (H,W) with its holes filled; openings to the frame's edge stay open."""
    loops, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = np.zeros(mask.shape, dtype=np.uint8)
    cv2.drawContours(filled, loops, -1, (1,), cv2.FILLED)
    return filled.astype(np.bool_)


def without_specks(mask: BoolArray, smallest: int = 0) -> BoolArray:
    """Mask (H,W) without pieces of fewer than `smallest` pixels; with 0 only the largest piece stays."""
    count, label, stats, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8), connectivity=4)
    if count <= 1:
        return mask.copy()
    area = stats[1:, cv2.CC_STAT_AREA]
    keep = np.zeros(count, dtype=np.bool_)
    keep[1:] = area >= smallest if smallest > 0 else area == area.max()
    kept: BoolArray = keep[label]
    return kept


def grown_mask(mask: BoolArray, distance: float) -> BoolArray:
    """Mask (H,W) with everything within `distance` pixels added; a negative distance takes as much away."""
    rest = mask if distance < 0 else ~mask
    far: BoolArray = cv2.distanceTransform(rest.view(np.uint8), cv2.DIST_L2, 5) > abs(distance)
    return far if distance < 0 else ~far


def smoothed_mask(mask: BoolArray, radius: float) -> BoolArray:
    """Mask (H,W) with its outline smoothed over `radius` pixels (sigma).

    Straight edges stay where they are.
    """
    if radius <= 0:
        return mask.copy()
    blurred = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), radius, borderType=cv2.BORDER_REPLICATE)
    smooth: BoolArray = blurred > 0.5
    return smooth


def mask_polygons(mask: BoolArray, tolerance: float = 0.7) -> list[FloatArray]:
    """Closed loops (n,2) around a mask (H,W), corners reduced within `tolerance` pixels.

    Outlines run clockwise on screen around filled parts and counter-clockwise around holes.
    """
    loops = []
    for loop in mask_loops(mask):
        reduced = cv2.approxPolyDP(loop.astype(np.float32)[:, None], tolerance, True)[:, 0].astype(np.float64)
        if len(reduced) >= 3:
            loops.append(reduced)
    return loops


def straightened(loop: FloatArray, most_corners: int = 6) -> FloatArray | None:
    """Polygon (n,2) of few corners that a closed loop (m,2) is within 1.5 % of its size; else None."""
    points = loop.astype(np.float32)[:, None]
    tolerance = max(2.0, 0.015 * float(np.sqrt(cv2.contourArea(points))))
    corners = cv2.approxPolyDP(points, tolerance, True)[:, 0].astype(np.float64)
    return corners if 3 <= len(corners) <= most_corners else None


def polygon_mask(loops: Sequence[ArrayLike], width: int, height: int) -> BoolArray:
    """Mask (height,width) of the pixels whose centres lie inside closed loops (n,2) (even-odd rule).

    Raises RegionError for a loop of fewer than three corners or one without numbers.
    """
    closed = [np.asarray(loop, dtype=np.float64) for loop in loops]
    if not closed:
        return np.zeros((height, width), dtype=np.bool_)
    for loop in closed:
        if loop.ndim != 2 or loop.shape[1] != 2 or len(loop) < 3:
            raise RegionError("An outline needs at least three corners: click on, or draw a longer stroke.")
        if not np.all(np.isfinite(loop)):
            raise RegionError("The outline has coordinates that are not numbers.")
    return fill_loops(closed, width, height)


def brush_mask(stroke: ArrayLike, radius: float, width: int, height: int) -> BoolArray:
    """Mask (height,width) of the pixels within `radius` of a stroke (n,2): a dot for one point."""
    points = np.atleast_2d(np.asarray(stroke, dtype=np.float64))
    if points.shape[1:] != (2,) or not np.all(np.isfinite(points)):
        raise RegionError("A brush stroke is a list of (u, v) pixels.")
    if radius <= 0:
        raise RegionError("The brush needs a radius of more than 0 pixels.")
    canvas = np.zeros((height, width), dtype=np.uint8)
    shift = 4  # cv2 draws at sixteenths of a pixel
    fixed = np.round(np.clip(points, -4e6, 4e6) * 2**shift).astype(np.int32)
    if len(points) > 1:
        cv2.polylines(canvas, [fixed[:, None]], False, (1,), max(1, round(2 * radius)), cv2.LINE_8, shift)
    for u, v in fixed[[0, -1]]:
        cv2.circle(canvas, (int(u), int(v)), round(radius * 2**shift), (1,), cv2.FILLED, cv2.LINE_8, shift)
    return canvas.astype(np.bool_)


def combined(mask: BoolArray | None, stroke: BoolArray, mode: str) -> BoolArray:
    """Mask after a stroke: `mode` is "replace", "add" or "subtract"."""
    if mode == "subtract":
        return stroke & False if mask is None else mask & ~stroke
    return mask | stroke if mode == "add" and mask is not None else stroke


def checked_selection(mask: BoolArray, least: int = 16) -> BoolArray:
    """The mask itself; raises RegionError when it has fewer than `least` pixels."""
    count = int(np.count_nonzero(mask))
    if count < least:
        pixels = "1 pixel" if count == 1 else f"{count} pixels"
        raise RegionError(
            f"The region has only {pixels}; it needs at least {least} to have an outline. "
            "Zoom in and mark a larger patch."
        )
    return mask
