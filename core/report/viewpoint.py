"""From where the report looks at the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import ArrayLike, FloatArray, IntArray
from ..cameras import PerspectiveCamera
from ..geometry.rigid import exp_so3
from ..photos.view import View

WIDTH, HEIGHT = 1200, 800
_HALF_FIELD = np.radians(20.0)
_TURN, _RAISE = np.radians(32.0), np.radians(12.0)


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A camera and its pose: `x_cam = rotation @ x_world + translation`, metres."""

    name: str
    camera: PerspectiveCamera
    rotation: FloatArray
    translation: FloatArray


def two_viewpoints(
    vertices: ArrayLike, faces: ArrayLike, views: Sequence[View]
) -> tuple[Viewpoint, Viewpoint]:
    """Two places that see what the photos see, from its left and from its right.

    The `faces` (F,3) of `vertices` (V,3) m that turn to a place are in its frame, but for a few outliers.
    Photos that look all around are in the middle of a room: then the second place looks the other way.
    """
    rotations = np.array([view.rotation for view in views])
    up = _upright(-rotations[:, 1].mean(axis=0))
    forward = rotations[:, 2].mean(axis=0)
    level = forward - up * (forward @ up)
    if np.linalg.norm(level) < 0.1:  # all around, or straight up or down: any side is as good
        level = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    one_sided = bool(np.linalg.norm(forward) > 0.4)
    turns = (-_TURN, _TURN if one_sided else np.pi - _TURN)
    names = ("from the left", "from the right") if one_sided else ("from one side", "from the other side")
    left, right = (
        _framed(vertices, faces, exp_so3(turn * up) @ level, up, name)
        for turn, name in zip(turns, names, strict=True)
    )
    return left, right


def _framed(vertices: ArrayLike, faces: ArrayLike, level: FloatArray, up: FloatArray, name: str) -> Viewpoint:
    """Look at all faces, then again at those alone that turn to the viewer."""
    triangles = np.asarray(faces)
    centres = np.asarray(vertices, dtype=np.float64)[triangles].mean(axis=1)
    viewpoint = _looking(centres, level, up, name)
    front = facing(vertices, triangles, viewpoint)
    return viewpoint if len(front) == 0 else _looking(centres[front], level, up, name)


def facing(vertices: ArrayLike, faces: ArrayLike, viewpoint: Viewpoint) -> IntArray:
    """Faces that turn their front to a viewpoint: with the others left out, one looks into rooms."""
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces)
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    centre = -viewpoint.rotation.T @ viewpoint.translation
    front = np.sum(np.cross(b - a, c - a) * (centre - a), axis=1) > 0
    return np.flatnonzero(front).astype(np.int32)


def _upright(up: FloatArray) -> FloatArray:
    """The cameras' mean up, or the axis of the world that is within 25 degrees of it."""
    if np.linalg.norm(up) < 1e-6:
        return np.array([0.0, 0.0, 1.0])
    up = up / np.linalg.norm(up)
    axis = int(np.argmax(np.abs(up)))
    if abs(up[axis]) > np.cos(np.radians(25)):
        up = np.sign(up[axis]) * np.eye(3)[axis]
    direction: FloatArray = up
    return direction


def _looking(points: FloatArray, level: FloatArray, up: FloatArray, name: str) -> Viewpoint:
    """Look along a horizontal direction, slightly downwards, from where all points fit in."""
    level = level / np.linalg.norm(level)
    forward = np.cos(_RAISE) * level - np.sin(_RAISE) * up
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(forward, right), forward])
    local = points @ rotation.T
    local = local - 0.5 * (np.percentile(local, 1, axis=0) + np.percentile(local, 99, axis=0))
    focal = 0.5 * WIDTH / np.tan(_HALF_FIELD)
    # A point at (x, y, z) is in the frame from the distance |x| focal / half the width - z on; so for y.
    needed = np.abs(local[:, :2]) * focal / (0.5 * np.array([WIDTH, HEIGHT])) - local[:, 2:]
    distance = 1.07 * float(np.percentile(needed.max(axis=1), 99)) + 1e-3
    matrix = np.array([[focal, 0, (WIDTH - 1) / 2], [0, focal, (HEIGHT - 1) / 2], [0, 0, 1]])
    translation = local[0] - rotation @ points[0] + (0.0, 0.0, distance)
    return Viewpoint(name, PerspectiveCamera(WIDTH, HEIGHT, matrix), rotation, translation)
