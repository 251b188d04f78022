"""Growing a region of like colour from a click, in CIELAB, stopping at edges."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..arrays import BoolArray, ByteArray, Float32Array
from .edges import Gradient
from .outline import without_holes

_SEED_RADIUS = 3  # pixels around the click whose colours make the seed
_EDGE_WEIGHT = 60.0  # colour distance (Delta E) that a unit of evened gradient counts for


@dataclass(frozen=True, eq=False)
class Growth:
    """One grown region: mask (H,W) without holes, and its score (higher.

    Its outline follows edges and is compact).
    """

    mask: BoolArray
    tolerance: float
    score: float


def colour_distance(colours: Float32Array, edges: Gradient, click: tuple[int, int]) -> Float32Array:
    """How unlike (H,W) every pixel is to the click's surroundings, in Delta E, edges raised.

    Lightness counts half as much as hue and chroma: shade falls across one wall. The seed's own scatter is
    taken off, so that a rough surface grows as easily as a smooth one.
    """
    u, v = click
    patch = colours[
        max(v - _SEED_RADIUS, 0) : v + _SEED_RADIUS + 1, max(u - _SEED_RADIUS, 0) : u + _SEED_RADIUS + 1
    ].reshape(-1, 3)
    weight = np.array([0.5, 1.0, 1.0], dtype=np.float32)
    seed = np.median(patch, axis=0)
    scatter = float(np.median(np.linalg.norm((patch - seed) * weight, axis=1)))
    unlike = np.sqrt(np.sum(((colours - seed) * weight) ** 2, axis=2)) - scatter
    edge = _EDGE_WEIGHT * np.hypot(edges.u, edges.v)
    return np.maximum(np.maximum(unlike, 0), edge).astype(np.float32)


def grown(distance: Float32Array, click: tuple[int, int], tolerance: float) -> BoolArray:
    """Pixels (H,W) joined to the click over distances of at most `tolerance`, holes filled."""
    u, v = click
    near = (distance <= tolerance).astype(np.uint8)
    near[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2] = 1
    barred = np.pad(1 - near, 1, constant_values=1)
    cv2.floodFill(near, barred, (u, v), (2,), flags=4 | (2 << 8))
    inside = barred[1:-1, 1:-1] == 2
    inside = cv2.dilate(inside.view(np.uint8), np.ones((3, 3), np.uint8)) > 0  # up to the middle of the edge
    return without_holes(inside)


def best_growth(distance: Float32Array, edges: Gradient, click: tuple[int, int], count: int) -> list[Growth]:
    """Regions for `count` tolerances, each scored by the edges along its outline and by how stable it is.

    Source: stability as in Matas et al., Robust wide-baseline stereo from maximally stable extremal
    regions, 2002.
    """
    tolerances = np.geomspace(1.5, 60.0, count)
    masks = [grown(distance, click, float(t)) for t in tolerances]
    areas = np.array([np.count_nonzero(m) for m in masks], dtype=float)
    growths = []
    for number, mask in enumerate(masks):
        if areas[number] < 30 or areas[number] > 0.6 * mask.size:
            continue
        neighbour = areas[min(number + 1, count - 1)]
        stability = areas[number] / max(neighbour, 1.0)
        growths.append(Growth(mask, float(tolerances[number]), _score(mask, edges, stability)))
    return growths


def _score(mask: BoolArray, edges: Gradient, stability: float) -> float:
    """Log score of a region: share and strength of edges along its outline, solidity, stability."""
    loops, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    loop = max(loops, key=len)
    outline = loop[:, 0].astype(np.float64)
    strength = np.linalg.norm(edges.at(outline), axis=1)
    off_frame = np.all((outline > 1) & (outline < np.array(mask.shape[::-1]) - 2), axis=1)
    share = float(np.mean((strength > 0.05) & off_frame))
    hull = cv2.contourArea(cv2.convexHull(loop))
    solidity = min(1.0, cv2.contourArea(loop) / max(hull, 1.0))
    strong = max(float(np.median(strength)), 1e-3)
    return float(
        np.log(max(share, 1e-3)) + 0.5 * np.log(strong) + 2 * np.log(max(solidity, 1e-3)) + np.log(stability)
    )


def as_click(pixel: tuple[float, float], image: ByteArray) -> tuple[int, int]:
    """Whole pixel of the image nearest to (u, v)."""
    height, width = image.shape[:2]
    return min(max(round(pixel[0]), 0), width - 1), min(max(round(pixel[1]), 0), height - 1)
