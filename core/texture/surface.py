"""The scan made ready for texturing: checked, near the origin, near faces together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import ArrayLike, Float32Array, FloatArray, IndexArray, IntArray
from ..errors import TextureError
from ..geometry.meshes import FaceBlocks, face_blocks, face_normals, morton_order
from ..geometry.rays import RayCaster, local_centre
from ..jobs import Job, Progress, drain

Mesh = tuple[ArrayLike, ArrayLike]
"""Vertices (V,3) in metres and faces (F,3)."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh with its faces in Morton order; `order` (F,) gives each face's index in the caller's mesh.

    `vertices` (V,3) float64 are relative to `origin` (3,) m, in the caller's order; `faces` (F,3),
    `centroid` (F,3), `normal` (F,3) and `area` (F,) m² follow `order`. `caster` also holds the occluders.
    """

    origin: FloatArray
    vertices: FloatArray
    faces: IntArray
    order: IndexArray
    centroid: Float32Array
    normal: Float32Array
    area: Float32Array
    blocks: FaceBlocks
    caster: RayCaster

    @classmethod
    def from_mesh(cls, vertices: ArrayLike, faces: ArrayLike, occluders: Sequence[Mesh] = ()) -> Surface:
        """Run `surface_job` to its end."""
        return drain(surface_job(vertices, faces, occluders))

    @property
    def face_count(self) -> int:
        """Number of faces."""
        return len(self.faces)


def surface_job(vertices: ArrayLike, faces: ArrayLike, occluders: Sequence[Mesh] = ()) -> Job[Surface]:
    """Check and sort a mesh (V,3) m, (F,3); `occluders` hide it but are not textured themselves.

    Raises TextureError for a mesh without faces, without finite coordinates or with indices out of range.
    """
    points, triangles = checked_mesh(vertices, faces)
    origin = local_centre(points)
    local = points - origin
    yield Progress(0.1, "Sorting the scan")
    a, b, c = (local[triangles[:, k]] for k in range(3))
    order = morton_order((a + b + c) / 3)
    triangles = np.ascontiguousarray(triangles[order])
    yield Progress(0.3, "Measuring the scan")
    normal, area = face_normals(local, triangles)
    yield Progress(0.5, "Measuring the scan")
    corners = local.astype(np.float32)[triangles]
    normal32 = normal.astype(np.float32)
    blocks = face_blocks(corners, normal32)
    centroid = (corners[:, 0] + corners[:, 1] + corners[:, 2]) / np.float32(3)
    yield Progress(0.7, "Preparing the scan for rays")
    caster = RayCaster(*_with_occluders(local, triangles, origin, occluders))
    area32 = area.astype(np.float32)
    return Surface(origin, local, triangles, order, centroid, normal32, area32, blocks, caster)


def checked_mesh(vertices: ArrayLike, faces: ArrayLike) -> tuple[FloatArray, IntArray]:
    """Vertices (V,3) float64 and faces (F,3) int32, or a TextureError that says what is wrong with them."""
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces)
    if points.ndim != 2 or points.shape[1] != 3:
        raise TextureError(f"The vertices must be a table of x, y, z; these have the shape {points.shape}.")
    if triangles.size == 0:
        raise TextureError(
            "The mesh has no faces: there is nothing to texture. Use colours for point clouds."
        )
    if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
        raise TextureError("The faces must be triangles: a table of three whole vertex numbers per face.")
    bad = int(np.count_nonzero(~np.isfinite(points).all(axis=1)))
    if bad:
        raise TextureError(
            f"{bad} of {len(points)} vertices have no finite coordinates; clean the scan first."
        )
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise TextureError(
            f"A face refers to vertex {int(max(triangles.max(), -triangles.min()))}, "
            f"but the mesh has {len(points)} vertices."
        )
    return points, np.ascontiguousarray(triangles, dtype=np.int32)


def used_vertices(faces: IntArray, vertex_count: int) -> tuple[IndexArray, IntArray]:
    """Vertices that faces (n,3) of a mesh use, ascending (m,), and the faces counted by them (n,3)."""
    used = np.zeros(vertex_count, dtype=np.bool_)
    used[faces] = True
    vertex = np.flatnonzero(used)
    number = np.empty(vertex_count, dtype=np.int32)  # of the used ones only: the rest is never touched
    number[vertex] = np.arange(len(vertex), dtype=np.int32)
    return vertex, number[faces]


def _with_occluders(
    local: FloatArray, faces: IntArray, origin: FloatArray, occluders: Sequence[Mesh]
) -> tuple[FloatArray, IntArray]:
    """Append the occluders to the mesh; its own faces keep their numbers."""
    points, triangles, count = [local], [faces], len(local)
    for mesh in occluders:
        other_points, other_faces = checked_mesh(*mesh)
        points.append(other_points - origin)
        triangles.append(other_faces + np.int32(count))
        count += len(other_points)
    return np.concatenate(points), np.concatenate(triangles)
