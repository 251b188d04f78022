"""What a camera can possibly see, for throwing away whole blocks of faces at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import BoolArray, FloatArray, IndexArray
from ...cameras.base import Camera
from ...geometry.meshes import FaceBlocks
from ...photos.view import View

_GRID = 33
_WIDEST = np.radians(80.0)
"""Half-angle up to which a frame is bounded by four planes; wider ones by their cone alone."""


@dataclass(frozen=True, eq=False)
class Frustum:
    """A cone about `axis` (3,), half-angle `reach` rad, and inward planes `normals` (P,3) with sine `slack`.

    Everything the camera sees lies within, in camera axes.
    """

    axis: FloatArray
    reach: float
    normals: FloatArray
    slack: FloatArray

    @classmethod
    def of_camera(cls, camera: Camera) -> Frustum:
        """Bounds of a camera's field, from a grid of its viewing rays."""
        u, v = np.linspace(-0.5, camera.width - 0.5, _GRID), np.linspace(-0.5, camera.height - 0.5, _GRID)
        grid = np.stack(np.meshgrid(u, v), axis=-1)
        rays = camera.unproject(grid.reshape(-1, 2)).reshape(_GRID, _GRID, 3)
        valid = np.isfinite(rays).all(axis=-1)
        seen = rays[valid]
        axis = seen.mean(axis=0)
        length = float(np.linalg.norm(axis))
        if length < 0.3:  # a field wider than a hemisphere: no cone
            return cls(np.array([0.0, 0.0, 1.0]), np.pi, np.zeros((0, 3)), np.zeros(0))
        axis /= length
        reach = float(np.arccos(np.clip((seen @ axis).min(), -1, 1)))
        if not valid.all():  # the field ends between the samples
            reach += np.pi / _GRID
        if reach > _WIDEST or not valid.all():
            return cls(axis, reach, np.zeros((0, 3)), np.zeros(0))
        corners = rays[[0, 0, -1, -1], [0, -1, -1, 0]]
        normals = np.cross(corners, np.roll(corners, -1, axis=0))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        normals *= np.sign(normals @ axis)[:, None]
        slack = np.maximum(0, -(seen @ normals.T).min(axis=0)) + 1e-3
        return cls(axis, reach, normals, slack)

    def meets(self, centre: FloatArray, radius: FloatArray) -> BoolArray:
        """Whether spheres may be seen: centres (B,3) in the camera frame, radii (B,) m -> (B,)."""
        distance = np.linalg.norm(centre, axis=1)
        inside: BoolArray = distance <= radius
        outside = ~inside & (distance > 0)
        direction = centre[outside] / distance[outside, None]
        own = np.arcsin(radius[outside] / distance[outside])
        inside[outside] = np.arccos(np.clip(direction @ self.axis, -1, 1)) <= self.reach + own + 1e-3
        for normal, slack in zip(self.normals, self.slack, strict=True):
            inside &= centre @ normal >= -(radius + slack * distance)
        return inside


def blocks_in_view(
    blocks: FaceBlocks,
    view: View,
    origin: FloatArray,
    max_angle: float | None,
    frustum: Frustum | None = None,
) -> IndexArray:
    """Blocks that may hold faces which the view sees at most at `max_angle` rad (None: from any side).

    `frustum` is that of the view's camera, if it is known already.
    """
    frustum = frustum or Frustum.of_camera(view.camera)
    towards = blocks.centre.astype(np.float64) - (view.centre - origin)
    radius = blocks.radius.astype(np.float64)
    candidates = frustum.meets(towards @ np.asarray(view.rotation).T, radius)
    if max_angle is not None:
        distance = np.linalg.norm(towards, axis=1)
        far = distance > radius
        own = np.arcsin(np.where(far, radius / np.where(far, distance, 1.0), 1.0))
        facing = -np.einsum("bk,bk->b", towards, blocks.axis) / np.where(far, distance, 1.0)
        turned = np.arccos(np.clip(facing, -1, 1)) - blocks.spread - own > max_angle + 1e-3
        candidates &= ~(turned & far)
    return np.flatnonzero(candidates)


def faces_of_blocks(chosen: IndexArray, size: int, face_count: int) -> IndexArray:
    """Numbers of the faces in the chosen blocks, ascending: (B,) -> (n,)."""
    faces = (chosen[:, None] * size + np.arange(size)).ravel()
    return faces[faces < face_count]
