"""Boundary loops of a triangulated patch: ordered, consistently oriented, without needless vertices."""

from __future__ import annotations

import numpy as np

from ..arrays import ArrayLike, FloatArray, IndexArray
from .runs import runs


def boundary_edges(faces: ArrayLike) -> IndexArray:
    """Directed edges (E,2) around a patch, in the direction of its faces: (F,3) -> (E,2).

    Faces that occur twice count once; faces wound against their neighbours are turned first. Where an edge
    belongs to more than two faces, opposite directions cancel: what is left still closes into loops.
    """
    faces = _distinct(np.asarray(faces, dtype=np.int64).reshape(-1, 3))
    edges = _directed_edges(faces)
    if len(np.unique(_directed_key(edges))) < len(edges):
        edges = _directed_edges(wound_alike(faces))
    ascending = np.sort(edges, axis=1)
    _, first, which = np.unique(_directed_key(ascending), return_index=True, return_inverse=True)
    upward = np.where(edges[:, 0] < edges[:, 1], 1, -1)
    net = np.bincount(which.reshape(-1), weights=upward).astype(np.int64)
    around = np.where(net[:, None] > 0, ascending[first], ascending[first][:, ::-1])
    left: IndexArray = np.repeat(around, np.abs(net), axis=0)
    return left


def _directed_key(edges: IndexArray) -> IndexArray:
    """One integer per directed edge (E,2) -> (E,)."""
    key: IndexArray = edges[:, 0] * (int(edges.max(initial=0)) + 1) + edges[:, 1]
    return key


def boundary_loops(faces: ArrayLike) -> list[IndexArray]:
    """Closed loops of vertex indices around a patch: (F,3) -> list of (n,), in the faces' winding.

    A vertex where the patch touches itself is passed by the loops one after the other.
    """
    edges = boundary_edges(faces)
    return link_loops(edges[:, 0], edges[:, 1])


def link_loops(starts: IndexArray, ends: IndexArray) -> list[IndexArray]:
    """Order directed edges (starts[i] -> ends[i]) into closed loops of indices; open chains are left out."""
    outgoing: dict[int, list[int]] = {}
    for edge, start in enumerate(starts.tolist()):
        outgoing.setdefault(start, []).append(edge)
    end_of, start_of = ends.tolist(), starts.tolist()
    loops = []
    for first in start_of:
        while outgoing.get(first):
            loop, vertex = [], first
            while outgoing.get(vertex):
                loop.append(vertex)
                vertex = end_of[outgoing[vertex].pop()]
            if vertex == first and len(loop) >= 3:
                loops.append(np.array(loop, dtype=np.int64))
    return loops


def without_collinear(loop: ArrayLike, tolerance: float) -> FloatArray:
    """Drop vertices of a closed polyline that lie on the chord of their neighbours: (n,d) -> (m,d).

    The polyline moves by less than 1.4 `tolerance`: every round drops non-adjacent vertices only, and the
    deviation of a smooth curve grows fourfold per round.
    """
    points = np.asarray(loop, dtype=np.float64)
    for _ in range(30):
        count = len(points)
        if count <= 4:
            break
        droppable = _deviation(points) < tolerance
        droppable[1::2] &= ~droppable[0::2][: count // 2]  # of two neighbours the even one goes first
        droppable[2::2] &= ~droppable[1::2][: len(droppable[2::2])]
        if count % 2 == 1 and droppable[0]:
            droppable[-1] = False
        if droppable[0] and droppable[-1]:
            droppable[-1] = False
        if not droppable.any():
            break
        points = points[~droppable]
    return points


def subdivided(loop: FloatArray, longest: float) -> FloatArray:
    """Closed polyline (n,d) with edges cut evenly so that none is longer than `longest`."""
    following = np.roll(loop, -1, axis=0)
    pieces = np.maximum(np.ceil(np.linalg.norm(following - loop, axis=1) / longest), 1).astype(np.int64)
    edge, within = runs(pieces)
    points: FloatArray = loop[edge] + (following - loop)[edge] * (within / pieces[edge])[:, None]
    return points


def _deviation(points: FloatArray) -> FloatArray:
    """Distance of every vertex of a closed polyline from the segment of its two neighbours."""
    before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
    chord = after - before
    length2 = np.maximum(np.sum(chord * chord, axis=1), 1e-300)
    along = np.clip(np.sum((points - before) * chord, axis=1) / length2, 0.0, 1.0)
    distance: FloatArray = np.linalg.norm(points - before - along[:, None] * chord, axis=1)
    return distance


def _directed_edges(faces: IndexArray) -> IndexArray:
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def _distinct(faces: IndexArray) -> IndexArray:
    """Drop faces with a repeated vertex and second copies of a face."""
    corners = np.sort(faces, axis=1)
    proper = (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2])
    faces, corners = faces[proper], corners[proper]
    _, corners = np.unique(corners, return_inverse=True)  # small numbers: three of them fit one integer
    corners = corners.reshape(-1, 3)
    count = int(corners.max(initial=0)) + 1
    if count > 2_000_000:
        raise ValueError("a region with more than two million vertices")
    _, first = np.unique((corners[:, 0] * count + corners[:, 1]) * count + corners[:, 2], return_index=True)
    kept: IndexArray = faces[np.sort(first)]
    return kept


def wound_alike(faces: IndexArray) -> IndexArray:
    """Turn faces so that neighbours wind alike, as most of their connected piece do: (F,3) -> (F,3)."""
    edges = _directed_edges(faces)
    owner = np.tile(np.arange(len(faces)), 3)
    key = np.sort(edges, axis=1)
    order = np.lexsort((key[:, 1], key[:, 0]))
    same = np.all(key[order[1:]] == key[order[:-1]], axis=1)
    first, second = order[:-1][same], order[1:][same]
    opposed = edges[first, 0] == edges[second, 0]
    neighbours: list[list[tuple[int, bool]]] = [[] for _ in range(len(faces))]
    for a, b, flip in zip(owner[first].tolist(), owner[second].tolist(), opposed.tolist(), strict=True):
        neighbours[a].append((b, flip))
        neighbours[b].append((a, flip))
    flipped = np.zeros(len(faces), dtype=bool)
    for piece, turned in _pieces(neighbours):
        flipped[piece] = turned if 2 * np.count_nonzero(turned) <= len(piece) else ~turned
    out = faces.copy()
    out[flipped] = out[flipped][:, ::-1]
    return out


def _pieces(
    neighbours: list[list[tuple[int, bool]]],
) -> list[tuple[IndexArray, np.ndarray[tuple[int], np.dtype[np.bool_]]]]:
    """Connected pieces with, per member, whether it is wound against the piece's first member."""
    turned: dict[int, bool] = {}
    pieces = []
    for seed in range(len(neighbours)):
        if seed in turned:
            continue
        turned[seed] = False
        members, stack = [], [seed]
        while stack:
            face = stack.pop()
            members.append(face)
            for other, flip in neighbours[face]:
                if other not in turned:
                    turned[other] = turned[face] ^ flip
                    stack.append(other)
        pieces.append((np.array(members, dtype=np.int64), np.array([turned[m] for m in members], dtype=bool)))
    return pieces
