"""The surface that a simplified mesh stands for: where its relief lies beneath a flat face."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray, IndexArray, IntArray
from ...geometry.meshes import vertex_normals
from ...geometry.rays import RayCaster
from ..surface import Mesh, checked_mesh
from .deviation import surface_deviation

_REACH = 3.0
"""How far relief is looked for, in 95th percentiles of the distance between the two meshes."""


class DetailSurface:
    """A detailed mesh (V,3) m, (F,3), looked up along the normals of the simplified one made from it."""

    def __init__(self, points: FloatArray, faces: IntArray, detail: Mesh) -> None:
        vertices, triangles = checked_mesh(*detail)
        self._caster = RayCaster(vertices, triangles)
        self._faces = faces
        self._normals = vertex_normals(points, faces)
        self._reach = _REACH * surface_deviation((points, faces), (vertices, triangles)).percentile_95

    def beneath(self, places: FloatArray, face: IndexArray, weights: FloatArray) -> FloatArray:
        """Points of the detailed mesh above or below places (n,3) m on the simplified one.

        `face` (n,) and `weights` (n,3) of its corners say where the places lie. Looked for along the smooth
        normal, so that neighbouring texels stay neighbours; the place itself where nothing is within reach.
        """
        normal = np.einsum("nk,nkc->nc", weights, self._normals[self._faces[face]])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = normal / np.where(length > 0, length, 1)
        # One ray from above meets what lies above and beneath; the outermost sheet is the one photos see.
        start = places + self._reach * normal
        depth = self._caster.first_hit(start, -normal).distance.astype(np.float64)
        met = depth <= 2 * self._reach
        found: FloatArray = places.copy()
        found[met] = start[met] - depth[met, None] * normal[met]
        return found
