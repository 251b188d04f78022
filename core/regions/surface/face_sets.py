"""Mending sets of faces, as masks are mended: grown, shrunk, filled, smoothed, freed of specks.

A set is (F,) bool; `pair` (E,2) are the numbers of neighbouring faces, as `geometry.meshes.edge_pairs` gives.
"""

from __future__ import annotations

import numpy as np

from ...arrays import BoolArray, FloatArray, IntArray
from .graph import labelled, reduced_pairs


def grown_faces(inside: BoolArray, pair: IntArray, rounds: int = 1) -> BoolArray:
    """Set with the faces added that share an edge with it, `rounds` times."""
    grown = inside.copy()
    for _ in range(rounds):
        touched = pair[grown[pair[:, 0]] != grown[pair[:, 1]]]
        grown[touched] = True
    return grown


def shrunk_faces(inside: BoolArray, pair: IntArray, rounds: int = 1) -> BoolArray:
    """Set without the faces that share an edge with others, `rounds` times; the scan's own border stays."""
    return ~grown_faces(~inside, pair, rounds)


def faces_without_specks(inside: BoolArray, pair: IntArray, area: FloatArray) -> BoolArray:
    """Connected piece of a set with the largest area (F,)."""
    members, label = _pieces(inside, pair)
    if len(members) == 0:
        return inside.copy()
    kept = np.zeros_like(inside)
    kept[members[label == np.argmax(np.bincount(label, area[members]))]] = True
    return kept


def faces_without_holes(inside: BoolArray, pair: IntArray, area: FloatArray) -> BoolArray:
    """Set with the pieces added that it encloses; a piece where the scan ends, or the largest, never is."""
    members, label = _pieces(~inside, pair)
    if len(members) == 0 or not inside.any():
        return inside.copy()
    count = int(label.max()) + 1
    neighbours = np.bincount(pair.ravel(), minlength=len(inside))
    open_end = np.bincount(label, neighbours[members] < 3, minlength=count) > 0
    open_end[np.argmax(np.bincount(label, area[members], minlength=count))] = True
    filled = inside.copy()
    filled[members[~open_end[label]]] = True
    return filled


def smoothed_faces(inside: BoolArray, pair: IntArray, rounds: int = 3) -> BoolArray:
    """Set whose faces do as most of their neighbours and themselves do, `rounds` times: teeth go."""
    smooth = inside.copy()
    count = 1 + np.bincount(pair.ravel(), minlength=len(inside))
    for _ in range(rounds):
        votes = smooth.astype(np.float64)
        votes += np.bincount(pair[:, 0], smooth[pair[:, 1]], minlength=len(inside))
        votes += np.bincount(pair[:, 1], smooth[pair[:, 0]], minlength=len(inside))
        smooth = np.where(2 * votes == count, smooth, 2 * votes > count)
    return smooth


def _pieces(inside: BoolArray, pair: IntArray) -> tuple[IntArray, IntArray]:
    """Faces (n,) of a set and the number (n,) of the connected piece that each belongs to."""
    members, pairs = reduced_pairs(pair, inside)
    return members, labelled(pairs[:, 0], pairs[:, 1], len(members))
