"""The best way along a strip: one place in every row, neighbours near each other.

Source: Amini, Weymouth and Jain, Using dynamic programming for solving variational problems in vision,
PAMI 1990.
"""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray, IndexArray

_KEPT = 128  # rows of a window that are kept
_OVERLAP = 64  # rows before and after them: farther off, rows say nothing about the best way


def best_path(strength: FloatArray, stiffness: float) -> IndexArray:
    """Column (n,) in every row of a closed strip (n,w) with the largest sum of strength.

    Neighbours are at most one column apart, for which `stiffness` is taken off. A long strip is walked in
    overlapping windows side by side, so that time grows with the window.
    """
    count = len(strength)
    if count <= 2 * (_KEPT + _OVERLAP):
        return _closed_path(strength, stiffness)
    windows = -(-count // _KEPT)
    first = np.round(np.arange(windows) * count / windows).astype(np.int64)
    rows = (first[:, None] + np.arange(-_OVERLAP, _KEPT + _OVERLAP)) % count
    paths = _paths(strength[rows], stiffness)
    path = np.empty(count, dtype=np.int64)
    for start, columns in zip(first, paths[:, _OVERLAP : _OVERLAP + _KEPT], strict=True):
        path[(start + np.arange(_KEPT)) % count] = columns
    return path


def _closed_path(strength: FloatArray, stiffness: float) -> IndexArray:
    """Path (n,) that ends where it began, in the row where the way is clearest."""
    rolled = int(np.argmax(strength.max(axis=1)))
    ordered = np.roll(strength, -rolled, axis=0)
    start = int(np.argmax(ordered[0]))
    closed = np.concatenate([ordered, ordered[:1]])
    closed[[0, -1]] = -np.inf
    closed[[0, -1], start] = ordered[0, start]
    return np.roll(_paths(closed[None], stiffness)[0, :-1], rolled)


def _paths(strength: FloatArray, stiffness: float) -> IndexArray:
    """Best columns (k,n) through k strips (k,n,w) that are open at both ends."""
    strips, count, width = strength.shape
    value = strength[:, 0]
    came = np.zeros((count, strips, width), dtype=np.int8)
    padded = np.full((strips, width + 2), -np.inf)
    for row in range(1, count):
        padded[:, 1:-1] = value
        best, step = value, np.zeros((strips, width), dtype=np.int8)
        for way, neighbour in ((-1, padded[:, :-2]), (1, padded[:, 2:])):
            better = neighbour - stiffness > best
            best = np.where(better, neighbour - stiffness, best)
            step[better] = way
        came[row] = step
        value = best + strength[:, row]
    path = np.empty((strips, count), dtype=np.int64)
    path[:, -1] = np.argmax(value, axis=1)
    every = np.arange(strips)
    for row in range(count - 1, 0, -1):
        path[:, row - 1] = path[:, row] + came[row, every, path[:, row]]
    return path
