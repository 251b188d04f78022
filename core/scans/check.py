"""Checking and mending a mesh; every change is told, face sets follow it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..arrays import BoolArray, ByteArray, Float32Array, FloatArray, IndexArray, IntArray
from ..errors import ScanError
from ..jobs import Job, Progress
from ..settings import ScanSettings
from .winding import faces_to_turn, shared_edges

_THINNEST = 1e-10
"""A triangle whose height is less than this part of its longest side has no area in double precision."""


@dataclass
class Mesh:
    """A mesh while it is being checked; the arrays are those of `Scan`."""

    vertices: FloatArray
    faces: IntArray
    file_faces: IntArray
    vertex_colors: ByteArray | None
    intensity: Float32Array | None
    face_sets: dict[str, IntArray]
    report: list[str] = field(default_factory=list)

    def keep_faces(self, keep: BoolArray) -> None:
        """Drop the other faces (F,) and renumber the face sets."""
        new_index = np.where(keep, np.cumsum(keep) - 1, -1).astype(np.int32)
        self.faces, self.file_faces = self.faces[keep], self.file_faces[keep]
        for name, chosen in self.face_sets.items():
            moved = new_index[chosen]
            self.face_sets[name] = moved[moved >= 0]

    def take_vertices(self, chosen: IndexArray, new_index: IndexArray) -> None:
        """Keep the vertices `chosen` (N,); `new_index` (V,) is where each old vertex goes."""
        self.vertices = self.vertices[chosen]
        self.vertex_colors = None if self.vertex_colors is None else self.vertex_colors[chosen]
        self.intensity = None if self.intensity is None else self.intensity[chosen]
        self.faces = new_index.astype(np.int32)[self.faces]


def check_mesh_job(mesh: Mesh, settings: ScanSettings, name: str) -> Job[None]:
    """Mend a mesh in place.

    Drops faces with undefined coordinates, without area, and repeated ones; joins vertices at the same place;
    turns over faces that look against their neighbours; drops vertices that no face uses. Raises
    ScanError when indices point nowhere or nothing is left.
    """
    _check_indices(mesh, name)
    if not len(mesh.faces):
        yield Progress(0.0, "Checking points")
        _drop_undefined_points(mesh, name)
        return
    steps = (
        ("undefined coordinates", _drop_undefined_faces),
        ("double vertices", lambda mesh: _weld(mesh, settings.weld_distance)),
        ("faces without area", _drop_flat_faces),
        ("double faces", _drop_double_faces),
        ("orientation", lambda mesh: _turn_faces(mesh, settings.turn_over)),
        ("unused vertices", _drop_unused_vertices),
    )
    for number, (what, step) in enumerate(steps):
        yield Progress(number / len(steps), f"Checking {what}")
        step(mesh)
        if not len(mesh.faces):
            raise ScanError(
                f"{name}: no usable face is left ({' '.join(mesh.report)}); export the scan again"
            )


def _check_indices(mesh: Mesh, name: str) -> None:
    count = len(mesh.vertices)
    if count == 0:
        raise ScanError(f"{name}: the scan has no points")
    outside = ((mesh.faces < 0) | (mesh.faces >= count)).any(axis=1)
    if outside.any():
        face = int(np.flatnonzero(outside)[0])
        wrong = int(mesh.faces[face][(mesh.faces[face] < 0) | (mesh.faces[face] >= count)][0])
        raise ScanError(
            f"{name}: face {mesh.file_faces[face]} refers to vertex {wrong}, but there are only {count}; "
            "the file is damaged or cut off, export it again"
        )


def _drop_undefined_points(mesh: Mesh, name: str) -> None:
    fine = np.isfinite(mesh.vertices).all(axis=1)
    if fine.all():
        return
    mesh.take_vertices(np.flatnonzero(fine), np.zeros(len(fine), dtype=np.int64))
    mesh.report.append(f"Dropped {_count(~fine)} points with undefined coordinates.")
    if not len(mesh.vertices):
        raise ScanError(f"{name}: all points have undefined coordinates; export the scan again")


def _drop_undefined_faces(mesh: Mesh) -> None:
    fine = np.isfinite(mesh.vertices).all(axis=1)
    if fine.all():
        return
    keep = fine[mesh.faces].all(axis=1)
    mesh.report.append(
        f"Found {_count(~fine)} vertices with undefined coordinates (NaN or infinite); "
        f"dropped the {_count(~keep)} faces that use them."
    )
    mesh.keep_faces(keep)


def _weld(mesh: Mesh, distance: float) -> None:
    """Join vertices at the same place: the outline of a region must not run along an invisible cut."""
    before = len(mesh.vertices)
    first = _identical(mesh.vertices) if distance <= 0 else _close(mesh.vertices, distance)
    chosen, new_index = np.unique(first, return_inverse=True)
    if len(chosen) == before:
        return
    mesh.take_vertices(chosen, new_index.reshape(-1))
    place = "the same place" if distance <= 0 else f"less than {1000 * distance:g} mm apart"
    mesh.report.append(f"Joined {before - len(chosen)} vertices at {place}.")


def _identical(vertices: FloatArray) -> IndexArray:
    """Return the first vertex (V,) at the same place as each vertex."""
    words = np.ascontiguousarray(vertices + 0.0).view(np.uint64)  # + 0.0: minus zero becomes zero
    odd = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
    mixed = words * odd
    mixed ^= mixed >> np.uint64(29)
    key = mixed[:, 0] ^ (mixed[:, 1] << np.uint64(1)) ^ (mixed[:, 2] << np.uint64(2))
    order = np.argsort(key, kind="stable")
    # Equal keys are neighbours now; compare the places themselves, a key may be equal by chance.
    new = np.concatenate([[True], (vertices[order[1:]] != vertices[order[:-1]]).any(axis=1)])
    first: IndexArray = np.empty(len(vertices), dtype=np.int64)
    first[order] = order[np.flatnonzero(new)][np.cumsum(new) - 1]
    return first


def _close(vertices: FloatArray, distance: float) -> IndexArray:
    """Return the first vertex (V,) of each chain of vertices less than `distance` (m) apart."""
    fine = np.flatnonzero(np.isfinite(vertices).all(axis=1))
    pairs = fine[cKDTree(vertices[fine]).query_pairs(distance, output_type="ndarray")]
    count = len(vertices)
    graph = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    _, first = np.unique(label, return_index=True)
    chain: IndexArray = first[label]
    return chain


def _drop_flat_faces(mesh: Mesh) -> None:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    longest = np.max([np.sum(side * side, axis=1) for side in (b - a, c - b, a - c)], axis=0)
    double_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    keep = double_area > _THINNEST * longest
    if not keep.all():
        mesh.report.append(f"Dropped {_count(~keep)} faces without area.")
        mesh.keep_faces(keep)


def _drop_double_faces(mesh: Mesh) -> None:
    """Keep the first of all faces between the same three vertices, whichever way they run."""
    corners = np.sort(mesh.faces, axis=1).astype(np.int64)
    order = np.lexsort((corners[:, 2], corners[:, 1], corners[:, 0]))
    corners = corners[order]
    again = np.concatenate([[False], (corners[1:] == corners[:-1]).all(axis=1)])
    if again.any():
        keep = np.ones(len(order), dtype=np.bool_)
        keep[order[again]] = False
        mesh.report.append(f"Dropped {_count(again)} faces that were there twice.")
        mesh.keep_faces(keep)


def _turn_faces(mesh: Mesh, turn_over: bool) -> None:
    pairs, same, crowded = shared_edges(mesh.faces, len(mesh.vertices))
    if crowded:
        mesh.report.append(f"{crowded} edges belong to more than two faces.")
    if same.any():
        a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
        turn, one_sided = faces_to_turn(np.linalg.norm(np.cross(b - a, c - a), axis=1), pairs, same)
        mesh.faces = np.where(turn[:, None], mesh.faces[:, ::-1], mesh.faces)
        if turn.any():
            mesh.report.append(f"Turned over {_count(turn)} faces that looked against their neighbours.")
        if one_sided:
            mesh.report.append(
                f"{one_sided} pieces have only one side (Möbius strip) and were left as they are."
            )
    if turn_over:
        mesh.faces = np.ascontiguousarray(mesh.faces[:, ::-1])
        mesh.report.append("Turned over all faces, as the settings ask.")


def _drop_unused_vertices(mesh: Mesh) -> None:
    used = np.zeros(len(mesh.vertices), dtype=np.bool_)
    used[mesh.faces.ravel()] = True
    if not used.all():
        mesh.take_vertices(np.flatnonzero(used), np.cumsum(used) - 1)
        mesh.report.append(f"Dropped {_count(~used)} vertices that no face uses.")


def _count(chosen: BoolArray) -> int:
    return int(np.count_nonzero(chosen))
