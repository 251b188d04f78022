"""Which texel of an atlas page belongs to which face, and where on it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...arrays import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from ...geometry.runs import runs

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

    A texel outside all triangles goes to the one whose edges it is nearest to.
    """
    lines = _edge_lines(uv)
    face_at = np.full(size * size, -1, dtype=np.int32)
    for face, texel in _spans(uv, lines, size, min(margin, 0.0)):
        free = face_at[texel] < 0
        # Of writes to the same texel the last stays: on a common edge the lower face.
        face_at[texel[free][::-1]] = face[free][::-1]
    if margin > 0:
        _fill_margin(face_at, uv, lines, size, margin)
    texel = np.flatnonzero(face_at >= 0)
    face = face_at[texel].astype(np.int64)
    row, column = (texel // size).astype(np.int32), (texel % size).astype(np.int32)
    return Texels(row, column, face, _weights(uv, face, column, row))


def _fill_margin(face_at: IntArray, uv: FloatArray, lines: FloatArray, size: int, margin: float) -> None:
    """Give the texels outside all triangles to the nearest one within `margin`."""
    depth_at = np.where(face_at >= 0, np.float32(np.inf), np.float32(-np.inf))
    for face, texel in _spans(uv, lines, size, margin):
        free = depth_at[texel] < np.inf
        face, texel = face[free], texel[free]
        place = np.stack([texel % size, texel // size, np.ones(len(texel))], axis=1)
        depth = np.einsum("nek,nk->ne", lines[face], place).min(axis=1).astype(np.float32)
        order = np.lexsort((-face, depth))  # the nearest is written last; ties go to the lower face
        face, texel, depth = face[order], texel[order], depth[order]
        better = depth > depth_at[texel]
        depth_at[texel[better]] = depth[better]
        face_at[texel[better]] = face[better]


def _weights(uv: FloatArray, face: IndexArray, column: IntArray, row: IntArray) -> Float32Array:
    """Weights (n,3) of the corners at texels; as `barycentric`, with what a face needs computed once."""
    start = uv[:, 0]
    zero, one, two = (barycentric(uv, start + step) for step in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)))
    x, y = column - start[face, 0], row - start[face, 1]
    along = zero, one - zero, two - zero
    weights = np.empty((len(face), 3), dtype=np.float32)
    for corner in range(3):
        base, right, down = (part[face, corner] for part in along)
        weights[:, corner] = base + right * x + down * y
    return weights


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


def _edge_lines(uv: FloatArray) -> FloatArray:
    """Lines (n,3,3) of the triangles' edges: `a x + b y + c` is the distance (pixels) inside of each."""
    edge = np.roll(uv, -1, axis=1) - uv
    length = np.maximum(np.hypot(edge[..., 0], edge[..., 1]), 1e-12)
    area = edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0]
    inward = np.where(area < 0, -1.0, 1.0)[:, None] / length
    a, b = -edge[..., 1] * inward, edge[..., 0] * inward
    return np.stack([a, b, -a * uv[..., 0] - b * uv[..., 1]], axis=-1)


def _spans(
    uv: FloatArray, lines: FloatArray, size: int, margin: float
) -> Iterator[tuple[IndexArray, IndexArray]]:
    """Triangle and texel number of everything within `margin` of the edges' lines, in portions."""
    low = np.clip(np.floor(uv.min(axis=1) - margin), 0, size - 1).astype(np.int64)
    high = np.clip(np.ceil(uv.max(axis=1) + margin), 0, size - 1).astype(np.int64)
    extent = np.maximum(high - low + 1, 0)
    portion = np.cumsum(extent.prod(axis=1)) // _SAMPLES
    bounds = np.searchsorted(portion, np.arange(portion[-1] + 2 if len(portion) else 1))
    for begin, end in pairwise(bounds.tolist()):
        face, inner = runs(extent[begin:end, 1])
        face += begin
        y = low[face, 1] + inner
        first, last = low[face, 0].astype(np.float64), high[face, 0].astype(np.float64)
        for a, b, c in np.moveaxis(lines, 1, 0)[:, face].transpose(0, 2, 1):
            with np.errstate(divide="ignore", invalid="ignore"):
                bound = -(b * y + c + margin) / a
            slanted = np.abs(a) > 1e-9
            first = np.where(slanted & (a > 0), np.maximum(first, np.ceil(bound - 1e-9)), first)
            last = np.where(slanted & (a < 0), np.minimum(last, np.floor(bound + 1e-9)), last)
            last = np.where(slanted | (b * y + c >= -margin - 1e-9), last, -1.0)
        span, inner = runs(np.maximum(last - first + 1, 0).astype(np.int64))
        yield face[span], (y[span] * size + first[span].astype(np.int64) + inner)
