"""glTF, GLB and STL meshes, read by trimesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import ByteArray, IntArray
from ..errors import ScanError
from ..jobs import Job, Progress
from .raw import RawScan


def read_mesh_job(path: Path) -> Job[RawScan]:
    """Read a glTF, GLB or STL file; every glTF object becomes a face set.

    glTF is y-up by its definition, see `RawScan.y_up`. Raises ScanError for a damaged file or an empty one.
    """
    import trimesh  # half a second that only those pay who read such a file

    yield Progress(0.0, f"Reading {path.name}")
    try:
        scene = trimesh.load_scene(str(path), process=False, maintain_order=True)
    except Exception as error:  # trimesh passes on whatever its readers meet in a damaged file
        raise ScanError(f"{path}: not a readable {path.suffix[1:].upper()} file ({error})") from error
    yield Progress(0.6, f"Reading {path.name}: objects")
    parts = list(_meshes(scene))
    if not parts:
        raise ScanError(f"{path}: the file has no triangles")
    return _joined(parts, y_up=path.suffix.lower() in (".gltf", ".glb"))


def _meshes(scene: Any) -> list[tuple[str, Any]]:
    """Names and meshes of all nodes, each placed in the scene."""
    placed = []
    for node in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        if getattr(mesh, "faces", None) is not None and len(mesh.faces):
            placed.append((str(node), mesh.copy().apply_transform(matrix)))
    return placed


def _joined(parts: list[tuple[str, Any]], y_up: bool) -> RawScan:
    first = np.cumsum([0, *(len(mesh.vertices) for _, mesh in parts)])
    vertices = np.concatenate([np.asarray(mesh.vertices, dtype=np.float64) for _, mesh in parts])
    faces = np.concatenate([mesh.faces + start for (_, mesh), start in zip(parts, first[:-1], strict=True)])
    sets: dict[str, IntArray] = {}
    start = 0
    for name, mesh in parts:
        if y_up:  # STL has no names
            sets[name] = np.arange(start, start + len(mesh.faces), dtype=np.int32)
        start += len(mesh.faces)
    owner = np.arange(len(faces), dtype=np.int32)
    colors = [_colors(mesh) for _, mesh in parts]
    return RawScan(
        vertices,
        faces.astype(np.int32),
        owner,
        len(faces),
        vertex_colors=None
        if any(c is None for c in colors)
        else np.concatenate([c for c in colors if c is not None]),
        face_sets=sets,
        single_precision=True,
        y_up=y_up,
    )


def _colors(mesh: Any) -> ByteArray | None:
    if mesh.visual.kind != "vertex":
        return None
    return np.ascontiguousarray(mesh.visual.vertex_colors[:, :3], dtype=np.uint8)
