"""PLY files: meshes and clouds, text or binary, with colours, intensity and face labels."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from plyfile import PlyData, PlyElement, PlyParseError

from ..arrays import AnyArray, ByteArray, Float32Array, FloatArray, IntArray
from ..errors import ScanError
from ..files import replacing
from ..jobs import Job, Progress
from .raw import RawScan, color_bytes, cut_polygons, no_faces

_CORNERS = ("vertex_indices", "vertex_index")
_INTENSITY = ("intensity", "scalar_intensity", "scalar_Intensity", "Intensity", "reflectance")
_COLORS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
_NOT_LABELS = {"red", "green", "blue", "alpha", "flags", "texnumber"}
_MOST_LABELS = 4096
"""More distinct values than this are face numbers, not labels of parts."""


def write_ply(path: Path, vertices: FloatArray, faces: IntArray) -> None:
    """Write a mesh as binary PLY in double precision: (V,3), (F,3). Raises OutputError."""
    corners = np.zeros(len(vertices), dtype=[(axis, "<f8") for axis in "xyz"])
    for number, axis in enumerate("xyz"):
        corners[axis] = vertices[:, number]
    polygons = np.zeros(len(faces), dtype=[("vertex_indices", "<i4", 3)])
    polygons["vertex_indices"] = faces
    elements = [PlyElement.describe(corners, "vertex"), PlyElement.describe(polygons, "face")]
    with replacing(path) as file:
        PlyData(elements, byte_order="<").write(file)


def read_ply_job(path: Path) -> Job[RawScan]:
    """Read a PLY file; integer properties of faces become face sets named “property value”.

    Raises ScanError for a damaged or truncated file.
    """
    yield Progress(0.0, f"Reading {path.name}")
    ply = _open(path)
    if "vertex" not in ply:
        raise ScanError(f"{path}: the PLY file has no vertices")
    vertex = ply["vertex"].data
    names = vertex.dtype.names or ()
    if not {"x", "y", "z"} <= set(names):
        raise ScanError(f"{path}: the vertices of the PLY file have no x, y, z")
    yield Progress(0.3, f"Reading {path.name}: vertices")
    vertices: FloatArray = np.stack([vertex[axis].astype(np.float64) for axis in "xyz"], axis=1)
    yield Progress(0.6, f"Reading {path.name}: faces")
    face = ply["face"].data if "face" in ply else None
    faces, owner, count = _triangles(face)
    return RawScan(
        vertices,
        faces,
        owner,
        count,
        vertex_colors=_vertex_colors(vertex),
        intensity=_intensity(vertex),
        face_sets=dict(_label_sets(face, owner)),
        single_precision=vertex.dtype["x"].itemsize < 8,
    )


def _open(path: Path) -> PlyData:
    """Parse the file; equally long corner lists, which nearly all files have, are mapped in one piece."""
    attempts: list[dict[str, Any]] = [
        {"known_list_len": {"face": {name: length}}} for length in (3, 4) for name in _CORNERS
    ]
    for options in [*attempts, {}]:
        try:
            return PlyData.read(str(path), **options)
        except (PlyParseError, ValueError, EOFError, UnicodeDecodeError) as error:
            reason = error
    raise ScanError(
        f"{path}: not a readable PLY file ({reason}); it may be truncated, copy or export it again"
    ) from reason


def _triangles(face: AnyArray | None) -> tuple[IntArray, IntArray, int]:
    """Triangles (F,3), the face of the file (F,) each comes from, and the number of faces in the file."""
    key = next((name for name in _CORNERS if face is not None and name in (face.dtype.names or ())), None)
    if face is None or key is None or len(face) == 0:
        return no_faces(), np.empty(0, dtype=np.int32), 0
    corners = face[key]
    if corners.dtype == object:
        counts = np.fromiter(map(len, corners), dtype=np.int64, count=len(corners))
        faces, owner = cut_polygons(np.concatenate(corners), counts)
    elif corners.shape[1] == 3:
        faces, owner = corners.astype(np.int32), np.arange(len(corners), dtype=np.int32)
    else:
        faces, owner = cut_polygons(corners.ravel(), np.full(len(corners), corners.shape[1]))
    return faces, owner, len(corners)


def _vertex_colors(vertex: AnyArray) -> ByteArray | None:
    for names in _COLORS:
        if set(names) <= set(vertex.dtype.names or ()):
            return color_bytes(np.stack([vertex[name] for name in names], axis=1))
    return None


def _intensity(vertex: AnyArray) -> Float32Array | None:
    for name in _INTENSITY:
        if name in (vertex.dtype.names or ()):
            return vertex[name].astype(np.float32)
    return None


def _label_sets(face: AnyArray | None, owner: IntArray) -> Iterator[tuple[str, IntArray]]:
    """Face sets from integer properties of the faces; 0 and negative values mean “no part”."""
    if face is None:
        return
    for name in face.dtype.names or ():
        if name in _CORNERS or name in _NOT_LABELS or not np.issubdtype(face.dtype[name], np.integer):
            continue
        labels = np.asarray(face[name])[owner]
        if labels.ndim != 1 or len(np.unique(labels)) > _MOST_LABELS:
            continue
        yield from label_sets(name, labels)


def label_sets(name: str, labels: AnyArray) -> Iterator[tuple[str, IntArray]]:
    """Split a label array (F,) into face sets named “name value”, one per positive value."""
    order = np.argsort(labels, kind="stable").astype(np.int32)
    values, starts = np.unique(labels[order], return_index=True)
    for value, part in zip(values, np.split(order, starts[1:]), strict=True):
        if value > 0:
            yield f"{name} {value}", part
