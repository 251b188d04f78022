"""What a file reader hands over: a scan exactly as the file has it, before any check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..arrays import AnyArray, ByteArray, Float32Array, FloatArray, IndexArray, IntArray
from ..geometry.runs import runs


@dataclass(frozen=True, eq=False)
class RawScan:
    """Contents of a scan file.

    `vertices` (V,3) in the file's unit and axes; `faces` (F,3), triangles; `file_faces` (F,) the polygon of
    the file each triangle was cut from, of `file_face_count`; `face_sets` names -> triangle indices;
    `single_precision` tells that the file itself rounds coordinates to 24 bits; `y_up` that its format
    puts the y axis up; `report` sentences for the user.
    """

    vertices: FloatArray
    faces: IntArray
    file_faces: IntArray
    file_face_count: int
    vertex_colors: ByteArray | None = None
    intensity: Float32Array | None = None
    face_sets: Mapping[str, IntArray] = field(default_factory=dict)
    single_precision: bool = False
    y_up: bool = False
    report: tuple[str, ...] = ()


def no_faces() -> IntArray:
    """Return the faces (0,3) of a point cloud."""
    return np.empty((0, 3), dtype=np.int32)


def cut_polygons(corners: AnyArray, counts: AnyArray) -> tuple[IntArray, IntArray]:
    """Cut polygons into triangle fans.

    `corners` holds the vertex indices of all polygons one after the other, `counts` (P,) how many each has.
    Returns the triangles (T,3) and the polygon (T,) each comes from; polygons with fewer than 3 corners give
    none. A fan follows the surface of convex polygons, which is what scanners and modellers write.
    """
    counts = np.asarray(counts, dtype=np.int64)
    per_polygon = np.maximum(counts - 2, 0)
    owner, nth = runs(per_polygon)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    start: IndexArray = first[owner]
    triangles = np.stack([start, start + nth + 1, start + nth + 2], axis=1)
    return np.asarray(corners, dtype=np.int64)[triangles].astype(np.int32), owner.astype(np.int32)


def color_bytes(colors: AnyArray) -> ByteArray:
    """Colours (N,3) as bytes: from bytes, 16-bit integers, or floats in 0..1."""
    if colors.dtype == np.uint8:
        same: ByteArray = np.ascontiguousarray(colors)
        return same
    if np.issubdtype(colors.dtype, np.floating):
        scaled: ByteArray = np.clip(np.rint(colors * 255.0), 0, 255).astype(np.uint8)
        return scaled
    # Many writers keep 8-bit values in 16-bit fields.
    wide = colors.size > 0 and int(colors.max()) > 255
    narrow: ByteArray = (colors >> 8 if wide else colors).astype(np.uint8)
    return narrow
