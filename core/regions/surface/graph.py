"""Graphs of faces or patches that touch: parts of them, and what hangs together."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ...arrays import AnyArray, ArrayLike, BoolArray, FloatArray, IndexArray, IntArray
from ...geometry.runs import runs


def ranges(start: IntArray, end: IntArray) -> IndexArray:
    """Whole numbers from each start to before its end, one after the other: (n,), (n,) -> (m,)."""
    run, place = runs((end - start).astype(np.int64))
    numbers: IndexArray = start[run] + place
    return numbers


def reduced_pairs(pair: IntArray, inside: BoolArray) -> tuple[IntArray, IntArray]:
    """Pairs between marked nodes, numbered among these.

    Pairs (E,2), inside (N,) -> members (n,), pairs (m,2).
    """
    members = np.flatnonzero(inside).astype(np.int32)
    number = np.cumsum(inside, dtype=np.int32) - 1
    kept = pair[inside[pair[:, 0]] & inside[pair[:, 1]]]
    return members, number[kept].astype(np.int32)


def component(pair: IntArray, inside: BoolArray, start: int) -> IndexArray:
    """Nodes (n,) joined to node `start` through marked ones (N,), sorted."""
    members, pairs = reduced_pairs(pair, inside)
    label = labelled(pairs[:, 0], pairs[:, 1], len(members))
    joined: IndexArray = members[label == label[np.searchsorted(members, start)]].astype(np.int64)
    return joined


def labelled(first: ArrayLike, second: ArrayLike, count: int) -> IntArray:
    """Component number (count,) of a graph with edges first[i] - second[i]."""
    edges = np.asarray(first), np.asarray(second)
    graph = coo_matrix((np.ones(len(edges[0])), edges), shape=(count, count))
    label: IntArray = connected_components(graph, directed=False)[1]
    return label


def from_neighbours(values: AnyArray, pair: IntArray, weight: AnyArray | float = 1.0) -> FloatArray:
    """Sum (N,k) of the neighbours' values (N,k), each pair (E,2) with a weight (E,)."""
    total = np.empty(values.shape)
    first, second = np.ascontiguousarray(pair[:, 0]), np.ascontiguousarray(pair[:, 1])
    for axis in range(values.shape[1]):
        column = np.ascontiguousarray(values[:, axis])
        total[:, axis] = np.bincount(first, weight * column[second], minlength=len(values))
        total[:, axis] += np.bincount(second, weight * column[first], minlength=len(values))
    return total


def means(label: IntArray, weight: FloatArray, values: AnyArray, total: FloatArray) -> FloatArray:
    """Weighted means (P,k) of values (N,k) by label (N,); the weights of a label sum up to total (P,)."""
    sums = [np.bincount(label, weight * values[:, k], minlength=len(total)) for k in range(values.shape[1])]
    mean: FloatArray = np.stack(sums, axis=1) / total[:, None]
    return mean
