"""Rays against a triangle mesh, cast by Embree.

Embree works in single precision, so coordinates are reduced to the mesh's own centre first: national grid
coordinates of millions of metres keep their millimetres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from ..arrays import ArrayLike, BoolArray, Float32Array, FloatArray, IntArray

_RELATIVE_STOP = 2e-5
"""Share of a segment's length before its end that is not tested: single precision at the target itself."""


@dataclass(frozen=True, eq=False)
class RayHits:
    """First hits: `face` (N,) is -1 and `distance` (N,) m is inf where a ray meets nothing."""

    face: IntArray
    distance: Float32Array


class RayCaster:
    """A triangle mesh made ready for ray casting; coordinates in metres, float64."""

    def __init__(self, vertices: ArrayLike, faces: ArrayLike) -> None:
        points = np.asarray(vertices, dtype=np.float64)
        triangles = np.ascontiguousarray(faces, dtype=np.int32)
        self.centre: FloatArray = local_centre(points)
        local = np.ascontiguousarray(points - self.centre, dtype=np.float32)
        self._margin = 4e-7 * float(np.abs(local).max(initial=0.0))
        self._scene = EmbreeScene()
        self._mesh = TriangleMesh(self._scene, local, triangles) if len(triangles) else None
        if self._mesh is not None:  # the first query builds the tree; later ones may come from threads
            self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32), query="OCCLUDED")

    def first_hit(self, origins: ArrayLike, directions: ArrayLike) -> RayHits:
        """First face along each ray: origins (3,) or (N,3) m, directions (N,3) of any length -> RayHits.

        Rays with a NaN or zero direction hit nothing.
        """
        towards = np.asarray(directions, dtype=np.float64)
        count = len(towards)
        face = np.full(count, -1, dtype=np.int32)
        distance = np.full(count, np.inf, dtype=np.float32)
        length = np.linalg.norm(towards, axis=1)
        valid = np.flatnonzero(np.isfinite(length) & (length > 0))
        if self._mesh is None or len(valid) == 0:
            return RayHits(face, distance)
        start = self._local(origins, count)[valid]
        unit = np.ascontiguousarray(towards[valid] / length[valid, None], dtype=np.float32)
        hit = self._scene.run(start, unit, output=True)
        struck = hit["primID"] >= 0
        face[valid] = np.where(struck, hit["primID"], -1)
        distance[valid] = np.where(struck, hit["tfar"], np.inf)
        return RayHits(face, distance)

    def occluded(self, origin: ArrayLike, targets: ArrayLike, tolerance: float = 0.0) -> BoolArray:
        """Whether the mesh stands between `origin` (3,) or (N,3) and each target (N,3): -> (N,), metres.

        Surfaces nearer than `tolerance` (m) in front of the target do not hide it; the surface that the
        target lies on never does.
        """
        points = np.asarray(targets, dtype=np.float64)
        if self._mesh is None or len(points) == 0:
            return np.zeros(len(points), dtype=np.bool_)
        start = self._local(origin, len(points))
        towards = np.ascontiguousarray(points - self.centre - start, dtype=np.float32)
        length = np.sqrt(np.einsum("nk,nk->n", towards, towards))
        stop = np.maximum(tolerance + self._margin, _RELATIVE_STOP * length)
        reach = 1.0 - stop / np.maximum(length, np.float32(1e-30))
        reach = np.where(np.isfinite(reach), reach, -1.0).astype(np.float32)
        hit = self._scene.run(start, np.nan_to_num(towards), dists=np.maximum(reach, 0), query="OCCLUDED")
        blocked: BoolArray = (hit >= 0) & (reach > 0)
        return blocked

    def _local(self, origins: ArrayLike, count: int) -> Float32Array:
        start = (np.asarray(origins, dtype=np.float64) - self.centre).astype(np.float32)
        return np.ascontiguousarray(np.broadcast_to(start, (count, 3)))


def local_centre(points: FloatArray) -> FloatArray:
    """Middle of the bounding box (3,) of points (N,3), the origin of single-precision coordinates."""
    if len(points) == 0:
        return np.zeros(3)
    centre: FloatArray = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return centre
