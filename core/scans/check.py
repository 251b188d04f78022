"""Checking and mending a mesh; every change is told, face sets follow it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
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


_BLOCK = 1 << 17
"""Faces handled at once: their numbers stay in the processor's cache."""


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
    if distance <= 0:
        first = _first_alike((mesh.vertices + 0.0).view(np.uint64))  # + 0.0: minus zero becomes zero
    else:
        first = _close(mesh.vertices, distance)
    stays = first == np.arange(before)
    if stays.all():
        return
    mesh.take_vertices(np.flatnonzero(stays), (np.cumsum(stays) - 1)[first])
    place = "the same place" if distance <= 0 else f"less than {1000 * distance:g} mm apart"
    mesh.report.append(f"Joined {_count(~stays)} vertices at {place}.")


def _first_alike(rows: NDArray[np.uint64]) -> IndexArray:
    """Return the first row (N,) that equals each of the rows (N,3)."""
    key = np.zeros(len(rows), dtype=np.uint64)
    for column in rows.T:
        key = (key + column) * np.uint64(0x9E3779B97F4A7C15)
        key ^= key >> np.uint64(32)
    order = np.argsort(key)
    # Equal keys are neighbours now; compare the rows themselves, a key may be equal by chance.
    new = np.concatenate([[True], key[order[1:]] != key[order[:-1]]])
    alike = np.flatnonzero(~new)
    new[alike] = (rows[order[alike]] != rows[order[alike - 1]]).any(axis=1)
    starts = np.flatnonzero(new)
    first: IndexArray = np.empty(len(rows), dtype=np.int64)
    first[order] = np.repeat(np.minimum.reduceat(order, starts), np.diff(starts, append=len(rows)))
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
    keep = np.empty(len(mesh.faces), dtype=np.bool_)
    for start in range(0, len(keep), _BLOCK):
        double_area, longest = _size(mesh.vertices, mesh.faces[start : start + _BLOCK])
        keep[start : start + _BLOCK] = double_area > _THINNEST * longest
    if not keep.all():
        mesh.report.append(f"Dropped {_count(~keep)} faces without area.")
        mesh.keep_faces(keep)


def _size(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Twice the area and the square of the longest side of faces: (F,), (F,)."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (vertices[faces[:, i]].T for i in range(3))
    ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    sides = [p * p + q * q + r * r for p, q, r in ((ux, uy, uz), (vx, vy, vz), (ux - vx, uy - vy, uz - vz))]
    return np.sqrt(x * x + y * y + z * z), np.maximum(np.maximum(sides[0], sides[1]), sides[2])


def _drop_double_faces(mesh: Mesh) -> None:
    """Keep the first of all faces between the same three vertices, whichever way they run."""
    a, b, c = mesh.faces.T
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    middle = a.astype(np.int64) + b + c - low - high
    keep = _first_alike(np.stack([low, middle, high], axis=1).astype(np.uint64)) == np.arange(len(a))
    if not keep.all():
        mesh.report.append(f"Dropped {_count(~keep)} faces that were there twice.")
        mesh.keep_faces(keep)


def _turn_faces(mesh: Mesh, turn_over: bool) -> None:
    pairs, same, crowded = shared_edges(mesh.faces, len(mesh.vertices))
    if crowded:
        mesh.report.append(f"{crowded} edges belong to more than two faces.")
    if same.any():
        turn, one_sided = faces_to_turn(_size(mesh.vertices, mesh.faces)[0], pairs, same)
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
