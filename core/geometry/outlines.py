"""Outlines of pixel masks and back, exactly: pixel centres at integers, pixel (u, v) spans u ± 0.5, v ± 0.5.

Loops are oriented so that the shoelace area in (u, v) is positive around filled parts, negative around holes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import BoolArray, FloatArray, IndexArray
from .runs import runs

# Directions of crack edges: right, down, left, up.
_STEPS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])


def mask_loops(mask: BoolArray) -> list[FloatArray]:
    """Pixel outlines ("cracks") of a mask: (H,W) -> closed loops (n,2) of (u, v) corners, one pixel apart.

    Diagonal neighbours are separate pieces (4-connected).
    """
    padded = np.zeros((mask.shape[0] + 2, mask.shape[1] + 2), dtype=np.int8)
    padded[1:-1, 1:-1] = mask
    corner, direction = _crack_edges(padded)
    successor = _successors(corner, direction, padded.shape[1])
    loops = []
    for order in _cycles(successor):
        v, u = np.divmod(corner[order], padded.shape[1])
        loops.append(np.stack([u - 1.5, v - 1.5], axis=1))
    return loops


def _crack_edges(padded: np.ndarray[tuple[int, int], np.dtype[np.int8]]) -> tuple[IndexArray, IndexArray]:
    """Directed crack edges, filled side on the right hand (v down): start corner index and direction.

    Corner (u, v) is the top-left corner of padded pixel (u, v).
    """
    width = padded.shape[1]
    across = np.diff(padded, axis=0)  # between row v and v + 1: corner row v + 1
    along = np.diff(padded, axis=1)  # between column u and u + 1: corner column u + 1
    parts = []
    v, u = np.nonzero(across == 1)  # filled below: go right
    parts.append(((v + 1) * width + u, np.zeros_like(u)))
    v, u = np.nonzero(across == -1)  # filled above: go left
    parts.append(((v + 1) * width + u + 1, np.full_like(u, 2)))
    v, u = np.nonzero(along == -1)  # filled on the left: go down
    parts.append((v * width + u + 1, np.full_like(u, 1)))
    v, u = np.nonzero(along == 1)  # filled on the right: go up
    parts.append(((v + 1) * width + u + 1, np.full_like(u, 3)))
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def _successors(corner: IndexArray, direction: IndexArray, width: int) -> IndexArray:
    """Index of the edge that follows each crack edge; with two ways out, turn towards the filled side."""
    key = corner * 4 + direction
    order = np.argsort(key)
    ordered = key[order]
    end = corner + _STEPS[direction, 0] + _STEPS[direction, 1] * width
    successor = np.full(len(corner), -1, dtype=np.int64)
    for turn in (3, 0, 1):  # left, straight on, right: the last one found wins
        wanted = end * 4 + (direction + turn) % 4
        place = np.minimum(np.searchsorted(ordered, wanted), len(ordered) - 1)
        found = ordered[place] == wanted
        successor[found] = order[place[found]]
    return successor


def _cycles(successor: IndexArray) -> list[IndexArray]:
    """Cycles of a permutation, as index arrays in order."""
    following = successor.tolist()
    seen = bytearray(len(following))
    cycles = []
    for first in range(len(following)):
        if seen[first]:
            continue
        cycle, here = [], first
        while not seen[here]:
            seen[here] = 1
            cycle.append(here)
            here = following[here]
        cycles.append(np.array(cycle, dtype=np.int64))
    return cycles


def fill_loops(loops: Sequence[FloatArray], width: int, height: int) -> BoolArray:
    """Mask (height, width) of pixels whose centres lie inside closed loops (n,2), by the even-odd rule."""
    starts = np.concatenate([np.asarray(loop, dtype=np.float64) for loop in loops])
    ends = np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])
    return fill_edges(starts, ends, width, height)


def fill_edges(starts: FloatArray, ends: FloatArray, width: int, height: int) -> BoolArray:
    """`fill_loops` for edges (E,2) -> (E,2) that close into loops, in any order."""
    upper = np.minimum(starts[:, 1], ends[:, 1])
    lower = np.maximum(starts[:, 1], ends[:, 1])
    first = np.clip(np.ceil(upper), 0, height).astype(np.int64)  # rows with upper <= v < lower
    count = np.clip(np.ceil(lower), 0, height).astype(np.int64) - first
    edge, place = runs(count)
    row = place + first[edge]
    slope = (ends[edge, 0] - starts[edge, 0]) / (ends[edge, 1] - starts[edge, 1])
    crossing = starts[edge, 0] + slope * (row - starts[edge, 1])
    column = np.clip(np.ceil(crossing), 0, width).astype(np.int64)
    filled = np.zeros((height, width), dtype=np.uint8)
    seen = column < width
    np.add.at(filled, (row[seen], column[seen]), 1)
    if np.any(seen):
        rows = np.s_[row[seen].min() : row[seen].max() + 1, column[seen].min() :]
        filled[rows] = np.bitwise_xor.accumulate(filled[rows] & 1, axis=1)
    return filled.view(np.bool_)


def loop_area(loops: Sequence[FloatArray]) -> float:
    """Signed shoelace area of closed loops (n,2)."""
    area = 0.0
    for loop in loops:
        following = np.roll(loop, -1, axis=0)
        area += 0.5 * float(np.sum(loop[:, 0] * following[:, 1] - loop[:, 1] * following[:, 0]))
    return area


def pieces_of(loops: Sequence[FloatArray]) -> list[list[FloatArray]]:
    """Closed loops (n,2) as pieces: each the outline of a filled part, then of the holes in it.

    Loops must not cross; a hole belongs to the smallest filled part around it.
    """
    areas = [loop_area([loop]) for loop in loops]
    filled = sorted((k for k in range(len(loops)) if areas[k] > 0), key=lambda k: areas[k])
    pieces = {k: [loops[k]] for k in filled}
    for k, loop in enumerate(loops):
        around = (j for j in filled if areas[k] <= 0 and areas[j] >= -areas[k] and _within(loop, loops[j]))
        for j in around:
            pieces[j].append(loop)
            break
    return [pieces[k] for k in reversed(filled)]


def _within(loop: FloatArray, around: FloatArray) -> bool:
    """Whether most points of a loop (n,2) lie inside another one (m,2), by crossings to their right."""
    ends = np.roll(around, -1, axis=0)
    v = loop[:, 1, None]
    spans = (around[:, 1] <= v) != (ends[:, 1] <= v)
    rise = ends[:, 1] - around[:, 1]  # level edges span no v, whatever their slope
    slope = (ends[:, 0] - around[:, 0]) / np.where(rise != 0, rise, 1.0)
    crossing = around[:, 0] + slope * (v - around[:, 1])
    inside = np.count_nonzero(spans & (crossing > loop[:, 0, None]), axis=1) % 2 == 1
    return bool(np.mean(inside) > 0.5)
