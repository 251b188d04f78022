"""Patches: small smooth pieces of a scan, so that a click looks at thousands of them, not at millions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from .graph import labelled, means, ranges

_WIDTH = 4.0  # of a patch, in distances of neighbouring faces
_MOST = 12_000  # patches of a smooth scan: with more a click would take too long
_BEND = 30.0  # degrees between neighbouring faces of one patch, at most
_ONE_COLOUR = 8.0  # Delta E below which neighbouring faces may be one patch


@dataclass(frozen=True, eq=False)
class SurfacePatches:
    """Pieces of a scan about four faces wide.

    `label` (F,) is the patch of every face; `middle` (P,3) m and `normal` (P,3) unit their means; `area`
    (P,) m²; `pair` (Q,2) neighbours; `rim` (P,) true where the scan ends or has a hole; `colour` (P,3)
    CIELAB or None. `order` (F,) lists the faces patch by patch: those of patch p from `start[p]` to before
    `start[p + 1]`; `width` m is a patch's usual one. `near` (E,2) are the neighbouring faces, sorted by the
    patch of the first: `near_start` (P + 1,).
    """

    label: IntArray
    middle: FloatArray
    normal: FloatArray
    area: FloatArray
    pair: IntArray
    rim: BoolArray
    colour: FloatArray | None
    tree: cKDTree
    order: IntArray
    start: IntArray
    near: IntArray
    near_start: IntArray
    width: float

    def faces(self, chosen: IndexArray) -> IndexArray:
        """Faces (n,) of chosen patches (m,), sorted."""
        return np.sort(self.order[ranges(self.start[chosen], self.start[chosen + 1])]).astype(np.int64)

    def face_pairs(self, chosen: IndexArray, members: IndexArray) -> IntArray:
        """Neighbours (m,2) among the faces `members` (n,), sorted, of chosen patches: numbers among these."""
        pair = self.near[ranges(self.near_start[chosen], self.near_start[chosen + 1])]
        inside = np.zeros(len(self.area), dtype=np.bool_)
        inside[chosen] = True
        pair = pair[inside[self.label[pair[:, 1]]]]
        number = np.empty(len(self.label), dtype=np.int32)
        number[members] = np.arange(len(members), dtype=np.int32)
        numbers: IntArray = number[pair]
        return numbers


def surface_patches(
    middle: FloatArray,
    smooth: FloatArray,
    area: FloatArray,
    pair: IntArray,
    spacing: float,
    colour: Float32Array | None,
) -> SurfacePatches:
    """Join neighbouring faces of one voxel whose smoothed normals (F,3) hardly turn.

    Middles (F,3) m, areas (F,) m², neighbours (E,2), their distance (m), and CIELAB colours (F,3) if any.
    """
    width = max(_WIDTH * spacing, float(np.sqrt(area.sum() / _MOST)), 1e-9)
    key = _voxels(middle, width)
    alike = key[pair[:, 0]] == key[pair[:, 1]]
    alike &= np.einsum("nk,nk->n", smooth[pair[:, 0]], smooth[pair[:, 1]]) > np.cos(np.radians(_BEND))
    if colour is not None:
        alike &= np.linalg.norm(colour[pair[:, 0]] - colour[pair[:, 1]], axis=1) < _ONE_COLOUR
    label = labelled(pair[alike, 0], pair[alike, 1], len(middle))
    count = int(label.max()) + 1
    weight = np.maximum(area, 1e-12 * max(float(area.max()), 1e-300))
    total = np.bincount(label, weight, minlength=count).astype(np.float64)
    normal = means(label, weight, smooth, total)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    rim = np.bincount(label, np.bincount(pair.ravel(), minlength=len(middle)) < 3, minlength=count) > 0
    place = means(label, weight, middle, total)
    tint = None if colour is None else means(label, weight, colour, total)
    patch = label[pair]
    touching = _touching(patch[~alike], count)
    near = pair[np.argsort(patch[:, 0], kind="stable")]
    return SurfacePatches(
        label, place, normal, total, touching, rim, tint, cKDTree(place),
        np.argsort(label, kind="stable").astype(np.int32), _starts(label, count),
        near, _starts(patch[:, 0], count), width,
    )  # fmt: skip


def _voxels(middle: FloatArray, size: float) -> IndexArray:
    """Number (F,) of the voxel that a point (F,3) lies in."""
    cell = np.floor((middle - middle.min(axis=0)) / size).astype(np.int64)
    key: IndexArray = (cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1]) * (cell[:, 2].max() + 1) + cell[:, 2]
    return key


def _starts(label: IntArray, count: int) -> IntArray:
    """Where the entries of each of `count` labels start when sorted by label: (count + 1,)."""
    starts = np.zeros(count + 1, dtype=np.int32)
    starts[1:] = np.cumsum(np.bincount(label, minlength=count))
    return starts


def _touching(patch: IntArray, count: int) -> IntArray:
    """Distinct pairs (Q,2) of different patches among pairs (E,2)."""
    across = np.sort(patch, axis=1).astype(np.int64)
    joint = np.unique(across[:, 0] * count + across[:, 1])
    neighbours = np.stack([joint // count, joint % count], axis=1).astype(np.int32)
    distinct: IntArray = neighbours[neighbours[:, 0] != neighbours[:, 1]]
    return distinct
