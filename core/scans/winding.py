"""Which way faces look: neighbours must run along their common edge in opposite directions."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ..arrays import BoolArray, FloatArray, IndexArray, IntArray


def shared_edges(faces: IntArray, vertex_count: int) -> tuple[IndexArray, BoolArray, int]:
    """Pairs of faces with a common edge.

    Returns the pairs (E,2), whether both run along the edge in the same direction (E,), that is, one of them
    is turned over, and how many edges belong to more than two faces (those are left out).
    """
    start, end = faces.astype(np.int64).ravel(), np.roll(faces, -1, axis=1).astype(np.int64).ravel()
    key = np.minimum(start, end) * vertex_count + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    key = key[order]
    bounds = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1], [True]]))
    size = np.diff(bounds)
    first = order[bounds[:-1][size == 2]]
    second = order[bounds[:-1][size == 2] + 1]
    pairs: IndexArray = np.stack([first // 3, second // 3], axis=1)
    same: BoolArray = start[first] == start[second]
    return pairs, same, int((size > 2).sum())


def faces_to_turn(areas: FloatArray, pairs: IndexArray, same: BoolArray) -> tuple[BoolArray, int]:
    """Faces (F,) to turn over so that each connected piece looks one way: the part with the smaller area.

    Every face stands in a graph twice, as it is and turned over; edges join what fits together. A connected
    piece then falls into two components, one the reverse of the other; where they are the same
    one the surface is one-sided (a Möbius strip) and stays as it is. Returns also the number of such pieces.
    """
    count = len(areas)
    a, b = pairs[:, 0], pairs[:, 1]
    twist = np.where(same, count, 0)
    rows = np.concatenate([a, a + count])
    columns = np.concatenate([b + twist, b + count - twist])
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(2 * count, 2 * count))
    components, label = connected_components(graph, directed=False)
    as_is, turned = label[:count], label[count:]
    weight = np.bincount(as_is, weights=areas, minlength=components)
    # A tie keeps the lower component, so that a piece of two equal halves is decided one way.
    lighter = weight[as_is] < weight[turned]
    tie = (weight[as_is] == weight[turned]) & (as_is > turned)
    one_sided = as_is == turned
    turn: BoolArray = (lighter | tie) & ~one_sided
    return turn, len(np.unique(as_is[one_sided]))
