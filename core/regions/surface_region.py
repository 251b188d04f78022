"""A region of the scan: a triangulated patch with a boundary."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import ArrayLike, FloatArray, IndexArray
from ..errors import RegionError
from ..geometry.boundary import boundary_loops
from .image_region import described


@dataclass(frozen=True, eq=False, init=False)
class SurfaceRegion:
    """A patch of the scan: vertices (V,3) in metres, faces (F,3); vertices that no face uses are allowed.

    Raises
    ------
    RegionError
        No faces, indices outside the vertices, coordinates that are no numbers, or no area.
    """

    vertices: FloatArray
    faces: IndexArray
    name: str

    def __init__(self, vertices: ArrayLike, faces: ArrayLike, name: str = ""):
        points = np.asarray(vertices, dtype=np.float64)
        triangles = np.asarray(faces)
        if triangles.size == 0:
            raise RegionError(f"{described(name)} has no faces: choose a patch of the scan's surface.")
        if triangles.ndim != 2 or triangles.shape[1] != 3 or points.ndim != 2 or points.shape[1] != 3:
            raise RegionError(f"{described(name)} needs vertices (V,3) and triangles (F,3).")
        triangles = triangles.astype(np.int64)
        if triangles.min() < 0 or triangles.max() >= len(points):
            raise RegionError(f"{described(name)} has faces that refer to vertices which do not exist.")
        object.__setattr__(self, "vertices", points)
        object.__setattr__(self, "faces", triangles)
        object.__setattr__(self, "name", name)

    @cached_property
    def loops(self) -> tuple[FloatArray, ...]:
        """Closed boundary loops (n,3) in metres, as wound by the faces.

        Raises
        ------
        RegionError
            The surface is closed, or its vertices are not finite.
        """
        loops = tuple(self.vertices[loop] for loop in boundary_loops(self.faces))
        if not loops:
            raise RegionError(
                f"{described(self.name)} is a closed surface: choose a patch of it that has an outline."
            )
        if not all(np.all(np.isfinite(loop)) for loop in loops):
            raise RegionError(
                f"{described(self.name)} has coordinates that are not numbers: repair the scan first."
            )
        return loops

    @cached_property
    def centre(self) -> FloatArray:
        """Mean of the boundary's vertices (3,), metres."""
        points = np.concatenate(self.loops)
        centre: FloatArray = points[0] + np.mean(points - points[0], axis=0)
        return centre
