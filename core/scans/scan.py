"""A scan as every other room takes it: checked, metric, near the origin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..arrays import ArrayLike, ByteArray, Float32Array, FloatArray, IntArray
from ..errors import ScanError


@dataclass(frozen=True, eq=False)
class Scan:
    """A triangle mesh, or a point cloud when it has no faces.

    `vertices` (V,3) are local metres: `world = vertices + offset`. National-grid coordinates have millions of
    metres; programs that keep single precision (Blender, glTF) only get the local part.
    `faces` (F,3) index the vertices. `file_faces` (F,) is the face of the file each one comes from, because
    the check may drop faces and cut polygons into triangles: arrays made for the file are read through it.
    `face_sets` names groups of faces by their indices into `faces`. `vertex_colors` (V,3) are sRGB as stored,
    `intensity` (V,) is in the file's own unit. `report` holds what the check found, one sentence each.
    """

    vertices: FloatArray
    faces: IntArray
    offset: FloatArray
    file_faces: IntArray
    file_face_count: int
    name: str = ""
    path: Path | None = None
    vertex_colors: ByteArray | None = None
    intensity: Float32Array | None = None
    face_sets: Mapping[str, IntArray] = field(default_factory=dict)
    report: tuple[str, ...] = ()

    @property
    def is_cloud(self) -> bool:
        """Whether the scan has points only."""
        return len(self.faces) == 0

    def world(self, points: ArrayLike) -> FloatArray:
        """World coordinates of local points: (N,3) -> (N,3), metres."""
        return np.asarray(points, dtype=np.float64) + self.offset

    def face_set(self, name: str) -> IntArray:
        """Face indices of a named set; raises ScanError that lists the names there are."""
        if name not in self.face_sets:
            known = ", ".join(self.face_sets) or "none"
            raise ScanError(f"{self.name}: the scan has no face set “{name}” (it has: {known})")
        return self.face_sets[name]
