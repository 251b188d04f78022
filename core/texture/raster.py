"""Which texel of an atlas page belongs to which face, and where on it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..arrays import BoolArray, Float32Array, FloatArray, IndexArray, IntArray

_SAMPLES = 4_000_000


@dataclass(frozen=True, eq=False)
class Texels:
    """The n covered texels of a page: `row`, `column` (n,), `face` (n,), `weights` (n,3) of its corners.

    Texels in the margin around a chart have weights outside [0, 1]: they lie on the plane of the face.
    """

    row: IntArray
    column: IntArray
    face: IndexArray
    weights: Float32Array


def rasterise(uv: FloatArray, size: int, margin: float = 1.5) -> Texels:
    """Texels of a page (`size` squared) covered by triangles (n,3,2) pixels or within `margin` of them.

    A texel met by several triangles goes to the one it lies deepest in.
    """
    face_at = np.full(size * size, -1, dtype=np.int32)
    depth_at = np.full(size * size, -np.inf, dtype=np.float32)
    for face, x, y in _boxes(uv, size, margin):
        depth = _depth(uv[face], np.stack([x, y], axis=1))
        near = depth >= -margin
        face, texel, depth = face[near], (y * size + x)[near], depth[near].astype(np.float32)
        order = np.lexsort((-face, depth))  # the deepest is written last; ties go to the lower face
        face, texel, depth = face[order], texel[order], depth[order]
        better = depth > depth_at[texel]
        # Writes with repeated indices keep the last, which is the deepest.
        depth_at[texel[better]] = depth[better]
        face_at[texel[better]] = face[better]
    texel = np.flatnonzero(face_at >= 0)
    face = face_at[texel].astype(np.int64)
    row, column = (texel // size).astype(np.int32), (texel % size).astype(np.int32)
    weights = barycentric(uv[face], np.stack([column, row], axis=1).astype(np.float64))
    return Texels(row, column, face, weights.astype(np.float32))


def barycentric(corners: FloatArray, points: FloatArray) -> FloatArray:
    """Weights of triangle corners (n,3,2) at points (n,2): -> (n,3); equal ones where there is no area."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = points - corners[:, 0]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    flat: BoolArray = np.abs(area) < 1e-12
    safe = np.where(flat, 1.0, area)
    v = (p[:, 0] * b[:, 1] - p[:, 1] * b[:, 0]) / safe
    w = (a[:, 0] * p[:, 1] - a[:, 1] * p[:, 0]) / safe
    weights: FloatArray = np.stack([1 - v - w, v, w], axis=1)
    weights[flat] = 1 / 3
    return weights


def _boxes(uv: FloatArray, size: int, margin: float) -> Iterator[tuple[IndexArray, IndexArray, IndexArray]]:
    """Triangle, column and row of every texel in the triangles' bounding boxes, in portions."""
    low = np.clip(np.floor(uv.min(axis=1) - margin), 0, size - 1).astype(np.int64)
    high = np.clip(np.ceil(uv.max(axis=1) + margin), 0, size - 1).astype(np.int64)
    extent = high - low + 1
    count = extent[:, 0] * extent[:, 1]
    portion = np.cumsum(count) // _SAMPLES
    for number in np.unique(portion):
        chosen = np.flatnonzero(portion == number)
        face = np.repeat(chosen, count[chosen])
        start = np.repeat(np.cumsum(count[chosen]) - count[chosen], count[chosen])
        inner = np.arange(len(face)) - start
        yield face, low[face, 0] + inner % extent[face, 0], low[face, 1] + inner // extent[face, 0]


def _depth(corners: FloatArray, points: FloatArray) -> FloatArray:
    """Signed distance (pixels) of points (n,2) inside their triangles (n,3,2): smallest over the edges."""
    edge = np.roll(corners, -1, axis=1) - corners
    length = np.maximum(np.hypot(edge[..., 0], edge[..., 1]), 1e-12)
    to = points[:, None] - corners
    side = (edge[..., 0] * to[..., 1] - edge[..., 1] * to[..., 0]) / length
    area = edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0]
    depth: FloatArray = np.where(area[:, None] < 0, -side, side).min(axis=1)
    return depth
