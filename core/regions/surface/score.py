"""How much a region grown around a click looks like one that a surveyor would mark."""

from __future__ import annotations

import numpy as np

from ...arrays import BoolArray, FloatArray, IntArray
from .graph import from_neighbours
from .growing import Part, SurfaceLevel

_TURNED = 25.0  # degrees beyond the border that make it a crease
_STEP = 4.0  # height of a clear step, in the usual differences of neighbouring patches of the region
_SLOPE = 0.09  # rise over a patch's width that is a clear step: where a fit bends away it is less
_END = 0.75  # how much the end of the scan tells beside a crease: the surface may go on there
# Weights beside that of the border, which is 1; learnt on made-up scans.
_FLAT, _CENTRAL, _UNTOUCHED, _STABLE = 0.5, 0.1, 0.1, 0.1


def shape_score(piece: Part, level: SurfaceLevel, noise: float, width: float) -> float:
    """Log score of a level, its patches numbered as in the part.

    Ended by creases and steps all around; then: thin for its size, around the click. `noise` m is the scan's,
    `width` m that of a patch.
    """
    if len(level.patches) < 4:
        return float(np.log(1e-3))
    inside = np.zeros(len(piece.node), dtype=np.bool_)
    inside[level.patches] = True
    first, second = piece.pair[:, 0], piece.pair[:, 1]
    across = inside[first] != inside[second]
    height = _heights(piece, level, ~across)
    within = piece.pair[inside[first] & inside[second]]
    inner = np.abs(height[within[:, 0]] - height[within[:, 1]])
    usual = max(1.4826 * float(np.median(inner)) if len(inner) else 0.0, 0.25 * noise, 1e-9)
    pair = piece.pair[across]
    ends = int(np.count_nonzero(inside & piece.rim))
    length = max(len(pair) + ends, 1)
    edges = _edges(piece, level, inside, pair, height, max(_STEP * usual, _SLOPE * width)).sum() + _END * ends
    crisp = np.log(max(edges / length, 1e-3)) if len(pair) + ends else 0.0
    flat = np.log(max(1 - 4 * level.tolerance / float(np.sqrt(level.area)), 0.05))
    score = crisp + _FLAT * flat - _CENTRAL * _off_centre(piece, level)
    return float(score if inside[piece.seed] else score - _UNTOUCHED)


def stability_score(area: float, larger: float) -> float:
    """Log score of a level of `area` m² whose next, more tolerant one has `larger`: few change is good."""
    return _STABLE * float(np.log(max(min(area, larger) / max(area, larger, 1e-300), 1e-3)))


def _off_centre(piece: Part, level: SurfaceLevel) -> float:
    """Squared distance of the click from the middle of the region, in its spreads; 4 at most.

    People click into the middle.
    """
    step = max(1, len(level.patches) // 2000)
    plane = (piece.middle[level.patches[::step]] - level.fit.centre) @ level.fit.axes[:2].T
    off = (piece.middle[piece.seed] - level.fit.centre) @ level.fit.axes[:2].T - plane.mean(axis=0)
    spread = np.cov(plane.T) + 1e-12 * np.eye(2)
    return min(float(off @ np.linalg.solve(spread, off)), 4.0)


def _heights(piece: Part, level: SurfaceLevel, same: BoolArray) -> FloatArray:
    """Height (n,) m of every patch over the fit, as its neighbours tell by pairs that stay on one side."""
    off = level.fit.distance(piece.middle)
    sums = from_neighbours(np.stack([off, np.ones(len(off))], axis=1), piece.pair[same])
    height: FloatArray = np.where(sums[:, 1] > 0, sums[:, 0] / np.maximum(sums[:, 1], 1), off)
    return height


def _edges(
    piece: Part, level: SurfaceLevel, inside: BoolArray, pair: IntArray, height: FloatArray, step: float
) -> FloatArray:
    """How clearly the region ends at pairs (n,2) across its border: 1 at creases and steps of `step` m."""
    beyond = np.where(inside[pair[:, 0]], pair[:, 1], pair[:, 0])
    normals = level.fit.normals(piece.middle[beyond])
    cosine = np.abs(np.einsum("nk,nk->n", piece.normal[beyond], normals))
    turned = np.degrees(np.arccos(np.clip(cosine, 0, 1)))
    jump = np.abs(height[pair[:, 0]] - height[pair[:, 1]])
    clear: FloatArray = np.minimum(np.maximum(jump / step, turned / _TURNED), 1.0) ** 2
    return clear
