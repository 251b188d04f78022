"""How far two meshes of the same thing lie apart, both ways, in metres.

Points spread evenly over each mesh are compared with the closest point of the other, not with its vertices:
on a simplified wall the next vertex is far away while the wall is where it was.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import FloatArray, IndexArray, IntArray
from ...errors import TextureError
from ...geometry.meshes import edge_pairs, face_normals
from ...geometry.rays import local_centre
from ..surface import Mesh, checked_mesh

_SAMPLES = 100_000
"""Points on either mesh; the 95th percentile is then known to about a hundredth of itself."""
_DENSITY = 4
"""Points per compared one on the other mesh, where they stand for the faces that may be closest."""
_NEAREST = 4
_STEPS = 2
"""Neighbours of neighbours that are tried."""


@dataclass(frozen=True)
class Deviation:
    """Distances between two meshes in metres, all points of both taken together.

    `median`, `rms`, `percentile_95`, `maximum`; `lost` is the largest distance from the first mesh to the
    second (what the second no longer has), `added` the one from the second to the first.
    """

    median: float
    rms: float
    percentile_95: float
    maximum: float
    lost: float
    added: float


def surface_deviation(first: Mesh, second: Mesh, samples: int = _SAMPLES) -> Deviation:
    """Compare two meshes (vertices (V,3) m, faces (F,3)) by points on both. Raises TextureError.

    Source: the two-sided distance of Aspert, Santa-Cruz and Ebrahimi 2002 (MESH). The points are the same in
    every run.
    """
    a, b = checked_mesh(*first), checked_mesh(*second)
    origin = local_centre(a[0])
    a, b = (a[0] - origin, a[1]), (b[0] - origin, b[1])
    lost = closest_distance(points_on(*a, samples)[0], *b)
    added = closest_distance(points_on(*b, samples)[0], *a)
    both = np.concatenate([lost, added])
    return Deviation(
        float(np.median(both)),
        float(np.sqrt(np.mean(both * both))),
        float(np.percentile(both, 95)),
        float(both.max()),
        float(lost.max()),
        float(added.max()),
    )


def points_on(vertices: FloatArray, faces: IntArray, count: int) -> tuple[FloatArray, IndexArray]:
    """`count` points (n,3) evenly over a mesh, and their faces (n,). Raises TextureError without any area."""
    area = face_normals(vertices, faces)[1]
    total = np.cumsum(area)
    if not total[-1] > 0:
        raise TextureError("The mesh has no area: all its faces are lines or points.")
    random = np.random.default_rng(0)
    at = (np.arange(count) + random.random(count)) / count * total[-1]
    face = np.minimum(np.searchsorted(total, at, side="right"), len(faces) - 1)
    root, along = np.sqrt(random.random(count)), random.random(count)
    weights = np.stack([1 - root, root * (1 - along), root * along], axis=1)
    return np.einsum("nk,nkc->nc", weights, vertices[faces[face]]), face


def closest_distance(points: FloatArray, vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Distance (n,) m of points (n,3) from a mesh.

    The faces tried are those of the nearest few points spread over the mesh, then the neighbours of the best
    of them: an upper bound that is exact unless a face is thinner than the spread points' spacing.
    """
    spread, face = points_on(vertices, faces, max(_DENSITY * len(points), 2 * len(faces)))
    spread = np.concatenate([spread, vertices[faces].mean(axis=1)])
    face = np.concatenate([face, np.arange(len(faces))])
    near = cKDTree(spread).query(points, k=min(_NEAREST, len(spread)), workers=-1)[1]
    tried = face[near].reshape(len(points), -1)
    neighbours = _neighbours(faces, len(vertices))
    distance = np.full(len(points), np.inf)
    best = tried[:, 0]
    for _ in range(1 + _STEPS):
        for column in tried.T:
            found = _distance_to_triangles(points, vertices[faces[column]])
            nearer = found < distance
            distance, best = np.where(nearer, found, distance), np.where(nearer, column, best)
        tried = neighbours[best]
    return distance


def _neighbours(faces: IntArray, vertex_count: int) -> IndexArray:
    """Faces across the edges of each face: (F,3), the face itself where there is none."""
    pairs = edge_pairs(faces, vertex_count).face.astype(np.int64)
    owner, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    order = np.argsort(owner, kind="stable")
    owner, other = owner[order], other[order]
    slot = np.arange(len(owner)) - np.searchsorted(owner, owner)
    table = np.repeat(np.arange(len(faces))[:, None], 3, axis=1)
    table[owner[slot < 3], slot[slot < 3]] = other[slot < 3]
    return table


def _distance_to_triangles(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Distance of each point (n,3) from its triangle (n,3,3): over the plane, or else to the nearest edge."""
    start = corners
    edge = np.roll(corners, -1, axis=1) - start
    to = points[:, None] - start
    along = np.einsum("nkc,nkc->nk", to, edge) / np.maximum(np.einsum("nkc,nkc->nk", edge, edge), 1e-300)
    off = to - np.clip(along, 0, 1)[..., None] * edge
    nearest = np.sqrt(np.einsum("nkc,nkc->nk", off, off).min(axis=1))
    normal = np.cross(edge[:, 0], -edge[:, 2])
    length = np.linalg.norm(normal, axis=1)
    flat = length <= 0
    unit = normal / np.where(flat, 1, length)[:, None]
    side = np.einsum("nkc,nkc->nk", np.cross(edge, to), np.repeat(unit[:, None], 3, axis=1))
    inside = (side >= 0).all(axis=1) & ~flat
    above = np.abs(np.einsum("nc,nc->n", to[:, 0], unit))
    distance: FloatArray = np.where(inside, above, nearest)
    return distance
