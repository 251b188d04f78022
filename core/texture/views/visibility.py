"""Which faces a photo sees: frame, mask, viewing side, and rays against everything that may stand between."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arrays import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from ...cameras.base import Camera
from ...photos.view import View
from ...settings import TextureSettings
from ..surface import Surface, used_vertices
from .frustum import blocks_in_view, faces_of_blocks
from .images import full_turn

_EXTRA_POINTS = np.array(
    [[9, 9, 2], [2, 9, 9], [9, 2, 9], [4, 1, 1], [1, 4, 1], [1, 1, 4], [18, 1, 1], [1, 18, 1], [1, 1, 18]],
    dtype=np.float64,
)
"""Barycentric weights of the points tested besides the centroid on faces near an occlusion."""


@dataclass(frozen=True, eq=False)
class SeenFaces:
    """What is kept of the n faces that a photo sees: see `VisibleFaces`; `centre` (n,2) pixels.

    Single precision: pixels of a photo are kept to a thousandth.
    """

    face: IntArray
    centre: Float32Array
    share: Float32Array
    texel: Float32Array
    cosine: Float32Array

    def __len__(self) -> int:
        return len(self.face)


@dataclass(frozen=True, eq=False)
class VisibleFaces:
    """The n faces of a surface that a photo sees.

    `face` (n,) counts in the surface's order; `uv` (n,3,2) pixels; `share` (n,) of the tested points that
    nothing hides; `texel` (n,) m, the side of a square pixel laid on the surface; `cosine` (n,) of the angle
    between viewing ray and normal; `distance` (n,) m.
    """

    face: IndexArray
    uv: FloatArray
    share: Float32Array
    texel: Float32Array
    cosine: Float32Array
    distance: Float32Array

    def __len__(self) -> int:
        return len(self.face)

    @cached_property
    def centre(self) -> FloatArray:
        """Mean of the corners' pixels: (n,2)."""
        mean: FloatArray = (self.uv[:, 0] + self.uv[:, 1] + self.uv[:, 2]) / 3
        return mean

    @property
    def summary(self) -> SeenFaces:
        """What is kept when the photo is closed."""
        return SeenFaces(
            self.face.astype(np.int32), self.centre.astype(np.float32), self.share, self.texel, self.cosine
        )

    def subset(self, keep: IndexArray | BoolArray) -> VisibleFaces:
        """The chosen ones only."""
        return VisibleFaces(
            self.face[keep],
            self.uv[keep],
            self.share[keep],
            self.texel[keep],
            self.cosine[keep],
            self.distance[keep],
        )


def visible_faces(surface: Surface, view: View, settings: TextureSettings) -> VisibleFaces:
    """Faces that `view` sees whole in its frame and mask, with at least `settings.visible_share` unhidden.

    Source: method.md 4, steps 1, 3 and 4; rays as in Embree (Wald et al. 2014).
    """
    seen = _in_front(surface, view, settings)
    seen = _in_frame(surface, view, seen)
    mask = view.usable if len(seen) else None
    if mask is not None:
        seen = seen.subset(_in_mask(seen.uv, mask, full_turn(view.camera) > 0))
    return _unhidden(surface, view, seen, settings)


def _in_front(surface: Surface, view: View, settings: TextureSettings) -> VisibleFaces:
    """Faces whose front looks at the camera within the largest angle."""
    limit = np.radians(settings.max_angle)
    blocks = blocks_in_view(surface.blocks, view, surface.origin, None if settings.double_sided else limit)
    face = faces_of_blocks(blocks, surface.blocks.size, surface.face_count)
    towards = (view.centre - surface.origin).astype(np.float32) - surface.centroid[face]
    distance = np.sqrt(np.einsum("nk,nk->n", towards, towards))
    cosine = np.einsum("nk,nk->n", towards, surface.normal[face]) / np.maximum(distance, np.float32(1e-12))
    if settings.double_sided:
        cosine = np.abs(cosine)
    keep = np.flatnonzero(cosine > np.cos(limit))
    none = np.zeros(len(keep), dtype=np.float32)
    return VisibleFaces(face[keep], np.zeros((len(keep), 0, 2)), none, none, cosine[keep], distance[keep])


def _in_frame(surface: Surface, view: View, seen: VisibleFaces) -> VisibleFaces:
    """Faces that lie whole in the frame, with their pixels and texel size."""
    vertex, corners = used_vertices(surface.faces[seen.face], len(surface.vertices))
    pixels = project(view, surface.vertices[vertex] + surface.origin)
    keep = np.flatnonzero(_at_corners(view.camera.in_frame(pixels), corners, np.logical_and))
    uv, whole = laid_out(view.camera, pixels[corners[keep]])
    area = triangle_areas(uv)
    seen = seen.subset(keep)
    with np.errstate(divide="ignore"):
        texel = np.sqrt(surface.area[seen.face] / area).astype(np.float32)
    valid = whole & (area > 0) & (surface.area[seen.face] > 0)
    framed = VisibleFaces(seen.face, uv, seen.share, texel, seen.cosine, seen.distance)
    return framed if valid.all() else framed.subset(valid)


def _in_mask(uv: FloatArray, mask: BoolArray, wraps: bool) -> BoolArray:
    """Whether corners and centre of each face lie in the usable area: (n,3,2), (H,W) -> (n,).

    The mask of a photo that `wraps` goes on at its other side.
    """
    points = np.concatenate([uv, uv.mean(axis=1, keepdims=True)], axis=1)
    height, width = mask.shape
    column = np.rint(points[..., 0]).astype(np.int64)
    column = column % width if wraps else np.clip(column, 0, width - 1)
    row = np.clip(np.rint(points[..., 1]).astype(np.int64), 0, height - 1)
    inside: BoolArray = mask[row, column].all(axis=1)
    return inside


def _unhidden(surface: Surface, view: View, seen: VisibleFaces, settings: TextureSettings) -> VisibleFaces:
    """Faces whose centroid is free, with the share of free points.

    Centroid and corners are tested on every face. Where any of them, or one next to it, is hidden, points
    inside the face decide: a corner itself may lie behind a neighbour by the scan's roughness alone.
    """
    eye = view.centre - surface.origin
    tolerance = settings.occlusion_tolerance
    hidden = surface.caster.occluded(eye, surface.centroid[seen.face], tolerance)
    vertex, corners = used_vertices(surface.faces[seen.face], len(surface.vertices))
    near = np.zeros(len(vertex), dtype=np.bool_)
    near[corners[hidden]] = True
    seen, corners = seen.subset(~hidden), corners[~hidden]
    place = surface.vertices[vertex]
    covered = np.zeros(len(vertex), dtype=np.bool_)
    covered[corners] = True
    covered[covered] = surface.caster.occluded(eye, place[covered], tolerance)
    near[corners[_at_corners(covered, corners, np.logical_or)]] = True
    share = np.ones(len(corners), dtype=np.float32)
    doubtful = np.flatnonzero(_at_corners(near, corners, np.logical_or))
    points = np.einsum("pk,nkc->npc", _EXTRA_POINTS, place[corners[doubtful]])
    points /= _EXTRA_POINTS.sum(axis=1)[:, None]
    blocked = surface.caster.occluded(eye, points.reshape(-1, 3), tolerance).reshape(-1, len(_EXTRA_POINTS))
    share[doubtful] = (1 + np.count_nonzero(~blocked, axis=1)) / (1 + len(_EXTRA_POINTS))
    checked = VisibleFaces(seen.face, seen.uv, share, seen.texel, seen.cosine, seen.distance)
    return checked.subset(np.flatnonzero(share >= settings.visible_share))


def _at_corners(of_vertex: BoolArray, corners: IntArray, combine: np.ufunc) -> BoolArray:
    """Combine what is true of vertices (V,) over the corners (n,3) of each face: -> (n,)."""
    # Column by column: reducing along an axis of three is many times slower.
    first, second, third = (of_vertex[corners[:, k]] for k in range(3))
    combined: BoolArray = combine(combine(first, second), third)
    return combined


def project(view: View, points: FloatArray) -> FloatArray:
    """Pixels of world points in a view: (N,3) m -> (N,2), NaN where the camera does not see them."""
    # Subtracting the centre first keeps the digits of coordinates in the millions.
    return view.camera.project((points - view.centre) @ np.asarray(view.rotation, dtype=np.float64).T)


def face_pixels(view: View, corners: FloatArray) -> FloatArray:
    """Pixels of faces' corners as a texture shows them: (n,3,3) m -> (n,3,2); see `laid_out`."""
    return laid_out(view.camera, project(view, corners.reshape(-1, 3)).reshape(-1, 3, 2))[0]


def laid_out(camera: Camera, uv: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Corners (n,3,2) of faces in a photo as connected triangles, and whether that is possible (n,).

    A face across a panorama's seam goes on beyond the frame, where a repeating texture shows the other side;
    its centre lies in the frame. A face around a pole cannot be laid out.
    """
    turn = full_turn(camera)
    if turn == 0:
        return uv, np.ones(len(uv), dtype=np.bool_)
    uv = camera.unwrapped(uv, uv[:, :1])
    whole: BoolArray = np.abs(uv[:, 1, 0] - uv[:, 2, 0]) < 0.5 * turn
    centre = (uv[:, 0, 0] + uv[:, 1, 0] + uv[:, 2, 0]) / 3
    uv[..., 0] -= (turn * np.floor((centre + 0.5) / turn))[:, None]
    return uv, whole


def triangle_areas(corners: FloatArray) -> FloatArray:
    """Areas of triangles in the plane: (n,3,2) -> (n,)."""
    x, y = corners[..., 0], corners[..., 1]
    ux, uy = x[:, 1] - x[:, 0], y[:, 1] - y[:, 0]
    vx, vy = x[:, 2] - x[:, 0], y[:, 2] - y[:, 0]
    area: FloatArray = 0.5 * np.abs(ux * vy - uy * vx)
    return area
