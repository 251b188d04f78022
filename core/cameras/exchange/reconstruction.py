"""What every program's cameras become here: photos with camera and pose, and sparse points."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from ...arrays import ArrayLike, ByteArray, FloatArray
from ...errors import CameraError
from ...geometry.rigid import camera_centre
from ..base import Camera
from ..files.dictionary import camera_to_dict

SizeOf: TypeAlias = Callable[[str], tuple[int, int]]
"""(width, height) of the photo with a name, for formats that do not tell it."""

_ROTATION_TOLERANCE = 1e-3
"""Largest deviation of a rotation's columns from orthonormal that counts as rounding in a file."""


@dataclass(frozen=True, eq=False)
class PosedCamera:
    """A photo's camera and pose: `x_cam = rotation @ x_world + translation`, OpenCV axes (x right, y down).

    `name` is the photo's as the file tells it, often with a folder or without its extension.
    """

    name: str
    camera: Camera
    rotation: FloatArray
    translation: FloatArray

    @property
    def centre(self) -> FloatArray:
        """Camera centre (3,) in the world."""
        return camera_centre(self.rotation, self.translation)


def _no_points() -> FloatArray:
    return np.empty((0, 3))


def _no_colours() -> ByteArray:
    return np.empty((0, 3), dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Posed photos in one world, whose unit and axes are the other program's until `transformed`.

    `points` (N,3) are sparse points in that world and `colours` (N,3) theirs; `unposed` names the photos that
    the file lists without a pose.
    """

    cameras: tuple[PosedCamera, ...]
    points: FloatArray = field(default_factory=_no_points)
    colours: ByteArray = field(default_factory=_no_colours)
    unposed: tuple[str, ...] = ()

    def transformed(self, scale: float, rotation: ArrayLike, translation: ArrayLike) -> Reconstruction:
        """The same in another world: `x_new = scale * rotation @ x + translation`, (3,3), (3,).

        Pixels do not change: camera frames are scaled, not distorted.
        """
        turn, shift = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)
        if not (np.isfinite(scale) and scale > 0):
            raise CameraError(f"A reconstruction can be scaled by a positive factor only, not by {scale}.")
        cameras = []
        for posed in self.cameras:
            new = posed.rotation @ turn.T
            centre = scale * turn @ posed.centre + shift
            cameras.append(PosedCamera(posed.name, posed.camera, new, -new @ centre))
        points = scale * self.points @ turn.T + shift
        return Reconstruction(tuple(cameras), points, self.colours, self.unposed)


def pose_from_centre(rotation: FloatArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
    """World-to-camera rotation (3,3) and translation (3,) from the rotation and the camera centre (3,)."""
    return rotation, -rotation @ centre


def checked_rotation(matrix: ArrayLike, what: str) -> FloatArray:
    """Rotation nearest to a matrix from a file (9 numbers or (3,3)), or CameraError if it is none."""
    values = np.asarray(matrix, dtype=np.float64).reshape(3, 3)
    u, _, vt = np.linalg.svd(values)
    rotation: FloatArray = u @ vt
    if np.abs(rotation - values).max() > _ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        raise CameraError(f"{what}: the rotation matrix is not a rotation.")
    return rotation


def rotation_from_quaternion(quaternion: FloatArray, what: str) -> FloatArray:
    """Rotation (3,3) of a quaternion w, x, y, z of any length but zero."""
    if not np.linalg.norm(quaternion) > 0:
        raise CameraError(f"{what}: the rotation is a quaternion of length zero.")
    return Rotation.from_quat(np.roll(quaternion, -1)).as_matrix()


def quaternion_from_rotation(rotation: FloatArray) -> FloatArray:
    """Unit quaternion w, x, y, z with w >= 0 of a rotation (3,3)."""
    return np.roll(Rotation.from_matrix(rotation).as_quat(canonical=True), 1)


def distinct_cameras(cameras: Sequence[PosedCamera]) -> tuple[list[Camera], list[int]]:
    """Cameras without repetition, and for every photo the index of its camera among them."""
    distinct: dict[str, int] = {}
    found: list[Camera] = []
    indices = []
    for posed in cameras:
        key = json.dumps(camera_to_dict(posed.camera))
        if key not in distinct:
            distinct[key] = len(found)
            found.append(posed.camera)
        indices.append(distinct[key])
    return found, indices
