"""Triangle meshes as arrays: normals, areas, neighbours, and an order that keeps near faces together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import AnyArray, ArrayLike, Float32Array, FloatArray, IndexArray, IntArray


def face_normals(vertices: ArrayLike, faces: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Unit normals and areas: (V,3) m, (F,3) -> (F,3), (F,) m²; a face without area has a zero normal."""
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces)
    a = points[triangles[:, 0]]
    normal = np.cross(points[triangles[:, 1]] - a, points[triangles[:, 2]] - a)
    length = np.linalg.norm(normal, axis=1)
    normal /= np.where(length > 0, length, 1.0)[:, None]
    return normal, 0.5 * length


def vertex_normals(vertices: ArrayLike, faces: ArrayLike) -> FloatArray:
    """Area-weighted unit normals: (V,3) m, (F,3) -> (V,3); zero where no face has an area."""
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces)
    normal, area = face_normals(points, triangles)
    weighted = normal * area[:, None]
    corners = triangles.ravel()
    out = np.empty_like(points)
    for axis in range(3):
        out[:, axis] = np.bincount(corners, np.repeat(weighted[:, axis], 3), minlength=len(points))
    length = np.linalg.norm(out, axis=1)
    out /= np.where(length > 0, length, 1.0)[:, None]
    return out


def barycentric(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Weights (...,3) of the corners of triangles (...,3,3) at points (...,3) on them, rounding clipped."""
    a, b = (triangles[..., corner, :] - triangles[..., 0, :] for corner in (1, 2))
    p = points - triangles[..., 0, :]
    aa, ab, bb = (a * a).sum(-1), (a * b).sum(-1), (b * b).sum(-1)
    pa, pb = (p * a).sum(-1), (p * b).sum(-1)
    inverse = 1.0 / np.maximum(aa * bb - ab * ab, 1e-30)
    v, w = (bb * pa - ab * pb) * inverse, (aa * pb - ab * pa) * inverse
    weights: FloatArray = np.clip(np.stack([1 - v - w, v, w], axis=-1), 0.0, 1.0)
    return weights


@dataclass(frozen=True, eq=False)
class EdgePairs:
    """Pairs of faces that share an edge: `face` (E,2) and the edge's two vertices, `vertex` (E,2).

    Where more than two faces meet in an edge (non-manifold), each is paired with the next.
    """

    face: IntArray
    vertex: IntArray


def edge_pairs(faces: ArrayLike, vertex_count: int) -> EdgePairs:
    """Neighbouring faces across every shared edge: (F,3) -> EdgePairs, sorted by edge."""
    triangles = np.asarray(faces, dtype=np.int64)
    start = triangles.ravel()
    end = np.roll(triangles, -1, axis=1).ravel()
    key = np.minimum(start, end) * vertex_count + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    key = key[order]
    same = np.flatnonzero((key[1:] == key[:-1]) & (key[1:] // vertex_count != key[1:] % vertex_count))
    face = np.stack([order[same] // 3, order[same + 1] // 3], axis=1).astype(np.int32)
    vertex = np.stack([key[same] // vertex_count, key[same] % vertex_count], axis=1).astype(np.int32)
    distinct = face[:, 0] != face[:, 1]
    return EdgePairs(face[distinct], vertex[distinct])


def morton_order(points: ArrayLike) -> IndexArray:
    """Order along a Z curve that keeps near points together: (N,3) -> (N,) indices.

    Source: Morton 1966; 10 bits per axis, interleaved.
    """
    coordinates = np.asarray(points, dtype=np.float64)
    if len(coordinates) == 0:
        return np.zeros(0, dtype=np.int64)
    low = coordinates.min(axis=0)
    size = max(float((coordinates.max(axis=0) - low).max()), 1e-300)
    cell = np.clip((coordinates - low) * (1023.999 / size), 0, 1023).astype(np.uint32)
    code = _spread(cell[:, 0]) << 2 | _spread(cell[:, 1]) << 1 | _spread(cell[:, 2])
    return np.argsort(code, kind="stable")


def _spread(x: AnyArray) -> AnyArray:
    """Move the lowest 10 bits of each number three places apart."""
    x = (x | x << 16) & 0x030000FF
    x = (x | x << 8) & 0x0300F00F
    x = (x | x << 4) & 0x030C30C3
    spread: AnyArray = (x | x << 2) & 0x09249249
    return spread


@dataclass(frozen=True, eq=False)
class FaceBlocks:
    """Runs of `size` faces with a sphere around each and a cone that holds its normals.

    `centre` (B,3) and `radius` (B,) m; `axis` (B,3) unit and `spread` (B,) rad, the cone's half-angle.
    """

    size: int
    centre: Float32Array
    radius: Float32Array
    axis: Float32Array
    spread: Float32Array


def face_blocks(corners: Float32Array, normals: Float32Array, size: int = 2048) -> FaceBlocks:
    """Blocks of consecutive faces: corners (F,3,3) m, unit normals (F,3) -> FaceBlocks."""
    starts = np.arange(0, len(corners), size)
    counts = np.diff(np.append(starts, len(corners)))[:, None]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    low = np.minimum.reduceat(np.minimum(np.minimum(a, b), c), starts, axis=0)
    high = np.maximum.reduceat(np.maximum(np.maximum(a, b), c), starts, axis=0)
    centre = 0.5 * (low + high)
    axis = np.add.reduceat(normals, starts, axis=0) / counts
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-12)
    cosine = np.einsum("fk,fk->f", normals, np.repeat(axis, counts[:, 0], axis=0))
    lowest = np.minimum.reduceat(np.where(np.any(normals != 0, axis=1), cosine, 1.0), starts)
    return FaceBlocks(
        size,
        centre.astype(np.float32),
        np.linalg.norm(high - centre, axis=1).astype(np.float32),
        axis.astype(np.float32),
        np.arccos(np.clip(lowest, -1, 1)).astype(np.float32),
    )
