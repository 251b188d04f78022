"""Which faces can bend: a cheap bound that spares the exact test to all but a few faces.

A straight edge of length e, seen at distance d or farther, is interpolated linearly with an error of at most
e² / 8 times the second derivative of the projection along it. The projection of a central camera does not
change along a ray, so that derivative is its value on the unit sphere over d². The bound is taken with the
largest value in the frame first, over whole blocks of faces, then with the largest one near the face.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ...arrays import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from ...cameras.base import Camera
from ...geometry.meshes import FaceBlocks, face_blocks
from ...photos.view import View
from ..views.frustum import Frustum, blocks_in_view, faces_of_blocks

_PROBES = 24
"""Rays across the frame (and as many down) at which a camera's curvature is measured."""
_STEP = 1e-4
_SAFETY = 1.25
"""What the curvature may rise between the probes."""
_UNEVEN = 4.0
"""Ratio of the largest to the median curvature from which it is worth to look at a face's own place."""


@dataclass(frozen=True, eq=False)
class LensCurvature:
    """How much a camera bends straight lines.

    `density` largest pixels per radian; `probes` (P,3) unit viewing rays; `cells` (n,n) largest second
    derivative (pixels per radian²) around each of a grid of places in the frame; `reach` (n,n) the angle
    (rad) around the place within which that holds; `frustum` bounds all that it sees.
    """

    density: float
    probes: FloatArray
    cells: FloatArray
    reach: FloatArray
    frustum: Frustum

    @classmethod
    def of_camera(cls, camera: Camera) -> LensCurvature:
        """Measure a camera on a grid of its rays, by differences of its Jacobian."""
        u = np.linspace(0, camera.width - 1, _PROBES)
        v = np.linspace(0, camera.height - 1, _PROBES)
        rays = camera.unproject(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
        second = np.zeros((len(rays), 2, 3, 3))
        for axis, step in enumerate(_STEP * np.eye(3)):
            ahead, behind = (camera.project_with_jacobian(rays + s)[1] for s in (step, -step))
            second[..., axis] = (ahead - behind) / (2 * _STEP)
        known = np.isfinite(second).all(axis=(1, 2, 3))
        symmetric = 0.5 * (second + second.swapaxes(2, 3))
        bend = np.abs(np.linalg.eigvalsh(np.where(known[:, None, None, None], symmetric, 0))).max(axis=2)
        size = np.where(known, np.hypot(bend[:, 0], bend[:, 1]), -np.inf)
        cells = ndimage.maximum_filter(size.reshape(_PROBES, _PROBES), 3, mode="nearest")
        cells = _SAFETY * np.where(np.isfinite(cells), cells, size.max(initial=0.0))
        density = np.sqrt(np.sum(camera.project_with_jacobian(rays)[1] ** 2, axis=(1, 2)))
        reach = _neighbour_angle(rays.reshape(_PROBES, _PROBES, 3))
        probes = rays[np.isfinite(rays).all(axis=1)]
        return cls(float(np.nanmax(density)), probes, cells, reach, Frustum.of_camera(camera))

    @property
    def largest(self) -> float:
        """Largest second derivative in the frame, pixels per radian²."""
        return float(self.cells.max())


def _neighbour_angle(rays: FloatArray) -> FloatArray:
    """Half the smallest angle from each ray of a grid (n,n,3) to the next ones: (n,n) rad, 0 unknown."""
    angle = np.full(rays.shape[:2], np.pi)
    across = np.linalg.norm(np.diff(rays, axis=1), axis=2)
    down = np.linalg.norm(np.diff(rays, axis=0), axis=2)
    for part, step in (
        (angle[:, 1:], across),
        (angle[:, :-1], across),
        (angle[1:], down),
        (angle[:-1], down),
    ):
        np.copyto(part, np.minimum(part, np.nan_to_num(step)))
    half: FloatArray = 0.5 * angle
    return half


class WideFaces:
    """Faces of a mesh, sorted into blocks, from which views pick those that may need splitting.

    `points` (V,3) m near their origin and `faces` (F,3); `chosen` (n,) are the faces in question, near ones
    together.
    """

    def __init__(
        self, points: FloatArray, faces: IntArray, chosen: IndexArray, double_sided: bool = False
    ) -> None:
        self.points, self.faces, self.chosen = points, faces, chosen
        self.double_sided = double_sided
        corners = points.astype(np.float32)[faces[chosen]]
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        normal = np.cross(b - a, c - a)
        length = np.sqrt(np.einsum("nk,nk->n", normal, normal))
        normal /= np.where(length > 0, length, np.float32(1))[:, None]
        self._normal: Float32Array = normal
        self._place: Float32Array = (a + b + c) / np.float32(3)
        self._edge: Float32Array = np.sqrt(
            np.maximum(np.maximum(_square(b - a), _square(c - b)), _square(a - c))
        )
        self._blocks: FaceBlocks = face_blocks(corners, normal)
        starts = np.arange(0, len(chosen), self._blocks.size)
        self._longest: Float32Array = np.maximum.reduceat(self._edge, starts)

    def seen_bent(self, view: View, lens: LensCurvature, origin: FloatArray, tolerance: float) -> IndexArray:
        """Numbers of faces that look at the view and whose edges may bend by more than `tolerance` pixels."""
        if len(self.chosen) == 0:
            return self.chosen
        eye = view.centre - origin
        blocks = self._bent_blocks(view, lens, origin, tolerance)
        face = faces_of_blocks(blocks, self._blocks.size, len(self.chosen))
        towards = self._place[face] - eye.astype(np.float32)
        edge = self._edge[face]
        distance = np.sqrt(_square(towards)) - edge
        near = _may_bend(edge, distance, lens.largest, tolerance)
        if not self.double_sided:
            # Half an edge off: with a rounded eye and place, faces seen edge-on stay in question.
            near &= np.einsum("nk,nk->n", towards, self._normal[face]) < 1e-4 * (edge + np.abs(distance))
        face, towards = face[near], towards[near]
        ahead = (towards @ np.asarray(view.rotation, dtype=np.float32).T).astype(np.float64)
        face = face[lens.frustum.meets(ahead, self._edge[face].astype(np.float64))]
        if lens.largest > _UNEVEN * float(np.median(lens.cells)):
            face = face[self._bent_there(face, view, lens, origin, tolerance)]
        return self.chosen[face]

    def _bent_blocks(
        self, view: View, lens: LensCurvature, origin: FloatArray, tolerance: float
    ) -> IndexArray:
        limit = None if self.double_sided else 0.5 * np.pi
        blocks = blocks_in_view(self._blocks, view, origin, limit, lens.frustum)
        offset = self._blocks.centre[blocks] - (view.centre - origin)
        distance = np.linalg.norm(offset, axis=1) - self._blocks.radius[blocks]
        return blocks[_may_bend(self._longest[blocks], distance, lens.largest, tolerance)]

    def _bent_there(
        self, face: IndexArray, view: View, lens: LensCurvature, origin: FloatArray, tolerance: float
    ) -> BoolArray:
        """Whether faces (n,) may bend by the curvature where they are seen; large ones always may."""
        towards = self._place[face].astype(np.float64) - (view.centre - origin)
        pixel = view.camera.project(towards @ np.asarray(view.rotation, dtype=np.float64).T)
        known = np.isfinite(pixel).all(axis=1)
        frame = np.array([view.camera.width - 1, view.camera.height - 1])
        at = np.rint(np.where(known[:, None], pixel, 0) / np.maximum(frame, 1) * (_PROBES - 1))
        column, row = np.clip(at, 0, _PROBES - 1).astype(np.int64).T
        edge = self._edge[face]
        length = np.linalg.norm(towards, axis=1)
        distance = length - edge
        large = edge > lens.reach[row, column] * np.maximum(distance, 0)
        bent: BoolArray = ~known | large | _may_bend(edge, distance, lens.cells[row, column], tolerance)
        return bent


def _may_bend(
    edge: Float32Array | FloatArray,
    distance: Float32Array | FloatArray,
    second: float | FloatArray,
    tolerance: float,
) -> BoolArray:
    """Whether edges (n,) m at distances of at least (n,) m may be off by more than `tolerance` pixels."""
    near: BoolArray = distance < edge
    bend: BoolArray = second * edge * edge > 8 * tolerance * distance * distance
    return near | bend


def _square(vectors: Float32Array) -> Float32Array:
    squared: Float32Array = np.einsum("nk,nk->n", vectors, vectors)
    return squared
