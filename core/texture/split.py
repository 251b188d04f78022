"""Splitting faces too large for straight UV edges.

A renderer interpolates UVs linearly within a face, while perspective and lens distortion are not linear.
Where the difference would be visible, or where no photo shows a large face whole, its edges are halved; both
neighbours of an edge are split alike, so that no gaps open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import ArrayLike, BoolArray, FloatArray, IndexArray, IntArray
from ..cameras.base import Camera
from ..geometry.meshes import face_normals
from ..geometry.rays import RayCaster, local_centre
from ..jobs import Job, Progress, drain
from ..photos.view import View
from .images import check_views, view_name
from .surface import checked_mesh
from .visibility import project

_ROUNDS = 14
_STEPS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
_FRAME_SHARE = 1 / 64
"""Edges longer than this share of the frame's diagonal are cut where a face leaves the frame."""
_PROBES = 24
"""Rays across the frame (and as many down) that find large faces seen only in part."""


@dataclass(frozen=True, eq=False)
class SplitMesh:
    """A refined mesh: vertices (V',3) m, faces (F',3), and `parent` (F',), each face's number before.

    The first V vertices are the original ones; `ends` (V' - V,2) are the vertices each new one halves.
    """

    vertices: FloatArray
    faces: IntArray
    parent: IntArray
    ends: IntArray


def split_large_faces(
    vertices: ArrayLike, faces: ArrayLike, views: Sequence[View], tolerance: float = 0.5
) -> SplitMesh:
    """Run `split_large_faces_job` to its end."""
    return drain(split_large_faces_job(vertices, faces, views, tolerance))


def split_large_faces_job(
    vertices: ArrayLike, faces: ArrayLike, views: Sequence[View], tolerance: float = 0.5
) -> Job[SplitMesh]:
    """Halve edges until straight UV edges are within `tolerance` pixels in every photo that sees the face.

    (V,3) m, (F,3) -> SplitMesh. Raises TextureError, PhotoError for input that cannot be used.
    """
    points, triangles = checked_mesh(vertices, faces)
    check_views(views)
    origin = local_centre(points)
    points = points - origin
    parent = np.arange(len(triangles), dtype=np.int32)
    doubtful = np.arange(len(triangles))
    ends = [np.zeros((0, 2), dtype=np.int32)]
    lenses = [_Lens.of_camera(view.camera) for view in views]
    for depth in range(_ROUNDS):
        flagged = np.zeros((len(triangles), 3), dtype=np.bool_)
        caster = RayCaster(points, triangles)
        for number, (view, lens) in enumerate(zip(views, lenses, strict=True)):
            yield Progress(
                (depth + number / len(views)) / _ROUNDS, f"Checking large faces in {view_name(view, number)}"
            )
            flagged |= _edges_to_cut(points, triangles, doubtful, view, lens, origin, caster, tolerance)
        if not flagged.any():
            break
        points, triangles, origin_face, halves = _halve(points, triangles, flagged)
        parent = parent[origin_face]
        doubtful = np.flatnonzero(np.isin(origin_face, np.flatnonzero(flagged.any(axis=1))))
        ends.append(halves)
    return SplitMesh(points + origin, triangles, parent, np.concatenate(ends))


@dataclass(frozen=True, eq=False)
class _Lens:
    """Largest pixel density of a camera (pixels per radian) and a grid of its viewing rays (P,3)."""

    density: float
    probes: FloatArray

    @classmethod
    def of_camera(cls, camera: Camera) -> _Lens:
        u = np.linspace(0, camera.width - 1, _PROBES)
        v = np.linspace(0, camera.height - 1, _PROBES)
        rays = camera.unproject(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
        rays = rays[np.isfinite(rays).all(axis=1)]
        jacobian = camera.project_with_jacobian(rays)[1]
        density = np.sqrt(np.sum(jacobian**2, axis=(1, 2)))
        return cls(float(np.nanmax(density)), rays)


def _edges_to_cut(
    points: FloatArray,
    faces: IntArray,
    doubtful: IndexArray,
    view: View,
    lens: _Lens,
    origin: FloatArray,
    caster: RayCaster,
    tolerance: float,
) -> BoolArray:
    """Which edges (F,3) a view wants halved; edge k runs from corner k to corner k + 1."""
    flagged = np.zeros((len(faces), 3), dtype=np.bool_)
    eye = view.centre - origin
    chosen = doubtful[_wide(points, faces[doubtful], eye, lens, tolerance)]
    if len(chosen) == 0:
        return flagged
    corners = points[faces[chosen]]
    pixels, angle = _along_edges(corners, view, origin)
    inside = view.camera.in_frame(pixels)
    error = _interpolation_error(pixels)
    bent = (error > tolerance) & inside.any(axis=2)
    rays = lens.probes @ np.asarray(view.rotation)
    probed = np.isin(chosen, caster.first_hit(eye, rays).face)
    partly = (inside.any(axis=(1, 2)) | probed) & ~inside.all(axis=(1, 2))
    longest = _FRAME_SHARE * float(np.hypot(view.camera.width, view.camera.height))
    cut = bent | (partly[:, None] & (angle * lens.density > longest))
    flagged[chosen] = cut
    return flagged


def _wide(points: FloatArray, faces: IntArray, eye: FloatArray, lens: _Lens, tolerance: float) -> IndexArray:
    """Faces that look at the eye and whose angular size can bend a straight edge by `tolerance` pixels."""
    corners = points[faces] - eye
    edge = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    distance = np.linalg.norm(corners, axis=2).min(axis=1)
    # A plane at depth z bends by about density * (edge / z)^2 / 8; twice that for oblique views and lenses.
    bend = 0.25 * lens.density * (edge / np.maximum(distance, 1e-9)) ** 2
    near = np.flatnonzero((bend > tolerance) | (edge > distance))
    normal, area = face_normals(corners[near].reshape(-1, 3), np.arange(3 * len(near)).reshape(-1, 3))
    facing = np.einsum("nk,nk->n", normal, corners[near, 0]) < 0
    wide: IndexArray = near[facing & (area > 0)]
    return wide


def _along_edges(corners: FloatArray, view: View, origin: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels of 5 points along each edge and each edge's angle seen: (n,3,3) -> (n,3,5,2), (n,3) rad."""
    after = np.roll(corners, -1, axis=1)
    along = corners[:, :, None] + _STEPS[:, None] * (after - corners)[:, :, None]
    pixels = project(view, along.reshape(-1, 3) + origin).reshape(*along.shape[:3], 2)
    rays = along - (view.centre - origin)
    rays /= np.maximum(np.linalg.norm(rays, axis=3, keepdims=True), 1e-12)
    step = np.linalg.norm(np.diff(rays, axis=2), axis=3)
    return pixels, step.sum(axis=2)


def _interpolation_error(pixels: FloatArray) -> FloatArray:
    """Largest distance between true and interpolated pixels along edges: (n,3,5,2) -> (n,3)."""
    straight = pixels[:, :, :1] + _STEPS[:, None] * (pixels[:, :, -1:] - pixels[:, :, :1])
    error = np.linalg.norm(pixels - straight, axis=3)
    largest: FloatArray = np.nan_to_num(error, nan=0.0).max(axis=2)
    return largest


def _halve(
    points: FloatArray, faces: IntArray, flagged: BoolArray
) -> tuple[FloatArray, IntArray, IndexArray, IntArray]:
    """Halve the flagged edges in every face that has them -> points, faces, each face's origin, new ends.

    A face with one such edge becomes two, with two three, with three four triangles.
    """
    count = len(points)
    start, end = faces.astype(np.int64), np.roll(faces, -1, axis=1).astype(np.int64)
    key = np.minimum(start, end) * count + np.maximum(start, end)
    cut_keys = np.unique(key[flagged])
    at = np.minimum(np.searchsorted(cut_keys, key), len(cut_keys) - 1)
    cut = cut_keys[at] == key
    ends = np.stack([cut_keys // count, cut_keys % count], axis=1)
    middle = 0.5 * (points[ends[:, 0]] + points[ends[:, 1]])
    new_faces, origin = [faces[~cut.any(axis=1)]], [np.flatnonzero(~cut.any(axis=1))]
    for pattern, pieces in _PATTERNS:
        for turn in range(3):
            if turn and all(pattern):
                break
            chosen = np.flatnonzero((cut == np.roll(pattern, turn)).all(axis=1))
            corner = np.roll(faces[chosen], -turn, axis=1)
            mid = np.roll(at[chosen], -turn, axis=1) + count
            both = np.concatenate([corner, mid], axis=1)
            new_faces.extend(both[:, piece] for piece in pieces)
            origin.extend([chosen] * len(pieces))
    triangles = np.concatenate(new_faces).astype(np.int32)
    parent = np.concatenate(origin)
    order = np.argsort(parent, kind="stable")
    return np.concatenate([points, middle]), triangles[order], parent[order], ends.astype(np.int32)


# Corners are 0, 1, 2; the middles of edges 0-1, 1-2, 2-0 are 3, 4, 5.
_PATTERNS: tuple[tuple[tuple[bool, bool, bool], tuple[list[int], ...]], ...] = (
    ((True, False, False), ([0, 3, 2], [3, 1, 2])),
    ((True, True, False), ([3, 1, 4], [0, 3, 4], [0, 4, 2])),
    ((True, True, True), ([0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5])),
)
