"""Which candidates are different poses, and which of them explain the regions as well as the best."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray, IndexArray
from ...geometry.rigid import rotation_angle
from .algebraic import Candidates

APART = np.radians(2.0)
"""Poses nearer to each other than this are one."""


def distinct(candidates: Candidates) -> Candidates:
    """Candidates, best first, without repetitions."""
    ordered = candidates.sorted()
    kept: list[int] = []
    for index in range(len(ordered)):
        if not np.isfinite(ordered.costs[index]):
            break
        if all(_angle(ordered, index, other) > APART for other in kept):
            kept.append(index)
    return ordered[np.array(kept, dtype=np.int64)]


def plausible(costs: FloatArray, equations: int, limit: float) -> IndexArray:
    """Indices of candidates whose cost exceeds the least by at most `limit` of its own noise variance."""
    noise = costs.min() / max(equations - 6, 1)
    chosen: IndexArray = np.flatnonzero(costs - costs.min() <= limit * noise)
    return chosen


def _angle(candidates: Candidates, one: int, other: int) -> float:
    return float(rotation_angle(candidates.rotations[one] @ candidates.rotations[other].T))
