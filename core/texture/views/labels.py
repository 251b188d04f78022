"""One photo per face with few, large patches: minimum cuts on the mesh.

The energy is the area-weighted cost of each face's photo plus, along every edge where the photo changes, its
length times a constant and the colour step it would show. It is minimised by alpha-expansion: for each photo
in turn, the best set of faces to hand over to it is a minimum cut. Source: Boykov, Veksler and Zabih 2001;
seam term after Kwatra et al. 2003 (graph-cut textures).
"""

from __future__ import annotations

from dataclasses import dataclass

import maxflow
import numpy as np

from ...arrays import AnyArray, BoolArray, ByteArray, Float32Array, FloatArray, IndexArray, IntArray
from ...geometry.meshes import EdgePairs, edge_pairs
from ...geometry.runs import runs
from ...jobs import Job, Progress
from ..surface import Surface
from .candidates import CandidateTable

_WORST = 4.0
"""Costs beyond this many octaves above a face's best photo do not matter any more."""
_HOPELESS = 2.5
"""A photo so many octaves worse than a face's best is not tried there."""
_SWEEPS = 3
_SETTLED = 2e-4
"""Share of faces changed by a sweep below which the labelling counts as settled."""
_SURROUNDINGS = 8
"""Rings of faces around the last changes that the next sweep looks at."""
_UNKNOWN_STEP = 0.05
"""Colour step assumed where the two photos cannot be compared."""


@dataclass(frozen=True, eq=False)
class SeamModel:
    """Cost of a seam per metre, in octaves x metres: `base` anywhere, plus `step` per unit of colour step."""

    base: float
    step: float


def label_faces_job(
    surface: Surface, table: CandidateTable, colours: ByteArray, smoothness: float
) -> Job[IntArray]:
    """Photo of every face, (F,), -1 where there is no candidate; `colours` (F,K,3) sRGB after the gains.

    `smoothness` is the length, in texels of the finest photos, at which a seam costs as much as one octave of
    resolution over its square; 0 gives each face its own best photo. The result is deterministic.
    """
    best = np.argmin(table.cost, axis=1)
    if smoothness <= 0:
        nearest: IntArray = table.view[np.arange(len(best)), best].astype(np.int32)
        return nearest
    yield Progress(0.0, "Finding neighbouring faces")
    expansion = _Expansion(surface, table, colours, best, smoothness)
    views = np.unique(table.view[table.filled])
    for sweep in range(_SWEEPS):
        for count, view in enumerate(views):
            yield Progress((sweep + count / len(views)) / _SWEEPS, "Joining faces into patches")
            expansion.expand(int(view))
        if expansion.settle() <= _SETTLED * len(best):
            break
    return expansion.labels()


class _Expansion:
    """State of the alpha-expansion: the slot chosen for each face."""

    def __init__(
        self, surface: Surface, table: CandidateTable, colours: ByteArray, slot: IndexArray, smoothness: float
    ) -> None:
        self.table, self.view, self.colours = table, table.view, colours.reshape(-1, 3)
        self.slot = slot.astype(np.int64)
        lowest = table.cost.min(axis=1, keepdims=True)
        with np.errstate(invalid="ignore"):
            self.above: Float32Array = np.minimum(table.cost - lowest, _WORST)
        self.area = surface.area
        self.node = np.full(len(slot), -1, dtype=np.int32)  # number in the current graph, -1 elsewhere
        self.alpha_slot = np.zeros(len(slot), dtype=np.int8)
        pairs, length = _seam_edges(surface, np.isfinite(lowest[:, 0]))
        self.first, self.second, self.length = pairs.face[:, 0], pairs.face[:, 1], length
        self.edges = _EdgesOfFaces(pairs, len(slot))
        seen = np.isfinite(lowest[:, 0])
        finest = float(np.median(table.texel[seen].min(axis=1))) if seen.any() else 0.0
        coarse = float(np.median(length)) if len(length) else 0.0
        base = 0.25 * max(smoothness * finest, 1.5 * coarse)
        self.seam = SeamModel(base, 8 * base)
        self.active = np.ones(len(slot), dtype=np.bool_)
        self.changed = np.zeros(len(slot), dtype=np.bool_)

    def labels(self) -> IntArray:
        """Photo of every face."""
        chosen: IntArray = self._view_at(np.arange(len(self.slot)), self.slot).astype(np.int32)
        return chosen

    def settle(self) -> int:
        """End a sweep: how many faces changed; the next one looks only at their surroundings."""
        count = int(np.count_nonzero(self.changed))
        self.active = self.changed
        for _ in range(_SURROUNDINGS):
            across = self.active[self.first] | self.active[self.second]
            self.active = self.active.copy()
            self.active[self.first[across]] = True
            self.active[self.second[across]] = True
        self.changed = np.zeros_like(self.changed)
        return count

    def expand(self, alpha: int) -> None:
        """Hand the best set of faces over to photo `alpha`."""
        face, slot = self.table.of_view(alpha)
        is_open = (self.slot[face] != slot) & self.active[face] & (self.above[face, slot] < _HOPELESS)
        face, slot = face[is_open], slot[is_open]
        if len(face) == 0:
            return
        node, alpha_slot = self.node, self.alpha_slot
        node[face] = np.arange(len(face))
        alpha_slot[face] = slot
        difference = self.above[face, slot] - self.above[face, self.slot[face]]
        unary = (difference * self.area[face]).astype(np.float64)
        graph = maxflow.GraphFloat(len(face), 2 * len(face))
        graph.add_nodes(len(face))
        self._add_edges(graph, unary, node, self.edges.around(face, node, self.first), alpha, alpha_slot)
        graph.add_grid_tedges(np.arange(len(face)), np.maximum(unary, 0), np.maximum(-unary, 0))
        graph.maxflow()
        moved = np.flatnonzero(graph.get_grid_segments(np.arange(len(face))))
        self.slot[face[moved]] = slot[moved]
        self.changed[face[moved]] = True
        node[face] = -1

    def _add_edges(
        self,
        graph: maxflow.GraphFloat,
        unary: FloatArray,
        node: IntArray,
        around: IndexArray,
        alpha: int,
        alpha_slot: AnyArray,
    ) -> None:
        """Pairwise terms: between two open faces an edge of the graph, beside a fixed face a unary term.

        With x = 1 for `alpha` and A, B, C the energies of (0,0), (0,1), (1,0), that of (1,1) being 0:
        A + (C - A) x_f - C x_g + (B + C - A)(1 - x_f) x_g.
        """
        f, g, length = self.first[around], self.second[around], self.length[around]
        a, b = node[f], node[g]
        for p, q, here, there in ((a, b, f, g), (b, a, g, f)):
            edge = np.flatnonzero((p >= 0) & (q < 0))
            self._add_fixed(unary, p[edge], here[edge], there[edge], length[edge], alpha, alpha_slot)
        edge = np.flatnonzero((a >= 0) & (b >= 0))
        f, g, length, a, b = f[edge], g[edge], length[edge], a[edge], b[edge]
        now_f, now_g = self.slot[f], self.slot[g]
        view_f, view_g = self._view_at(f, now_f), self._view_at(g, now_g)
        step_f = self._step(f, now_f, alpha_slot[f])
        step_g = self._step(g, now_g, alpha_slot[g])
        same = view_f == view_g
        both = 0.5 * (step_f + step_g)
        keep_g = length * self._price(np.where(same, both, step_f))  # B: f stays, g changes
        keep_f = length * self._price(np.where(same, both, step_g))  # C: f changes, g stays
        keep = np.zeros(len(edge))  # A: both stay
        seam = np.flatnonzero(~same)
        keep[seam] = length[seam] * self._price(
            self._step_between(f[seam], g[seam], now_f[seam], now_g[seam])
        )
        unary += np.bincount(a, keep_f - keep, len(unary)) - np.bincount(b, keep_f, len(unary))
        graph.add_edges(a, b, np.maximum(keep_g + keep_f - keep, 0), np.zeros(len(edge)))

    def _add_fixed(
        self,
        unary: FloatArray,
        node: IntArray,
        open_face: IntArray,
        fixed: IntArray,
        length: Float32Array,
        alpha: int,
        alpha_slot: AnyArray,
    ) -> None:
        """Seams towards faces that keep their photo."""
        now, other = self.slot[open_face], self.slot[fixed]
        fixed_view = self._view_at(fixed, other)
        differs = self._view_at(open_face, now) != fixed_view
        cost = np.zeros(len(node))
        at = np.flatnonzero(fixed_view != alpha)
        step = self._step_between(open_face[at], fixed[at], alpha_slot[open_face[at]], other[at])
        cost[at] += length[at] * self._price(step)
        at = np.flatnonzero(differs)
        step = self._step_between(open_face[at], fixed[at], now[at], other[at])
        cost[at] -= length[at] * self._price(step)
        unary += np.bincount(node, cost, len(unary))

    def _price(self, step: Float32Array) -> FloatArray:
        price: FloatArray = self.seam.base + self.seam.step * step.astype(np.float64)
        return price

    def _at(self, face: AnyArray, slot: AnyArray) -> IndexArray:
        """Rows of faces' slots where (F,K,...) is flattened: taking rows is faster than indexing twice."""
        return face.astype(np.int64) * self.table.slots + slot

    def _view_at(self, face: AnyArray, slot: AnyArray) -> AnyArray:
        """Photos in slots of faces: (n,), (n,) -> (n,)."""
        return self.view.take(self._at(face, slot))

    def _step(self, face: IntArray, slot_a: IndexArray, slot_b: AnyArray) -> Float32Array:
        """Colour step [0, 1] on a face between two of its slots."""
        a = self.colours.take(self._at(face, slot_a), axis=0).astype(np.int16)
        d = np.abs(a - self.colours.take(self._at(face, slot_b), axis=0))
        # Column by column: reducing along an axis of three is many times slower.
        step: Float32Array = (d[:, 0] + d[:, 1] + d[:, 2]).astype(np.float32) / np.float32(765)
        return step

    def _step_between(self, f: IntArray, g: IntArray, slot_f: AnyArray, slot_g: IndexArray) -> Float32Array:
        """Mean colour step on both sides of an edge between f's photo and g's, where it is known."""
        total, known = np.zeros(len(f), np.float32), np.zeros(len(f), np.float32)
        view_f, view_g = self._view_at(f, slot_f), self._view_at(g, slot_g)
        for face, own, view in ((f, slot_f, view_g), (g, slot_g, view_f)):
            other = np.argmax(self.view.take(face, axis=0) == view[:, None], axis=1)
            has: BoolArray = self._view_at(face, other) == view
            total += np.where(has, self._step(face, own, other), 0)
            known += has
        return np.where(known > 0, total / np.maximum(known, 1), np.float32(_UNKNOWN_STEP))


class _EdgesOfFaces:
    """The edges around each face, in one run per face."""

    def __init__(self, pairs: EdgePairs, face_count: int) -> None:
        owner = pairs.face.T.ravel()
        order = np.argsort(owner, kind="stable")
        self.edge = (order % max(len(pairs.face), 1)).astype(np.int32)
        self.start = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=face_count))])

    def around(self, face: IndexArray, node: IntArray, first: IntArray) -> IndexArray:
        """Every edge that touches the faces, once; `node` is -1 on all other faces."""
        count = self.start[face + 1] - self.start[face]
        owner, place = runs(count)
        edge = self.edge[self.start[face[owner]] + place]
        # An edge between two of the faces is met twice: it belongs to its first one.
        once: IndexArray = edge[(first[edge] == face[owner]) | (node[first[edge]] < 0)]
        return once


def _seam_edges(surface: Surface, seen: BoolArray) -> tuple[EdgePairs, Float32Array]:
    """Edges between faces that have candidates, and their lengths in m."""
    pairs = edge_pairs(surface.faces, len(surface.vertices))
    keep = seen[pairs.face].all(axis=1)
    pairs = EdgePairs(pairs.face[keep], pairs.vertex[keep])
    ends = surface.vertices[pairs.vertex]
    return pairs, np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).astype(np.float32)
