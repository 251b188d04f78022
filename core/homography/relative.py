"""Relative poses from a homography: by its decomposition, or with the vertical known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import ArrayLike, FloatArray
from ..errors import PoseNotFound
from ..geometry.rigid import rotation_between
from .estimate import unit_scale

_SINGULAR = 1e-12  # of the cubed norm, up to which a determinant is none
_TURN_ONLY = 1e-7  # singular values nearer to 1 than this are 1; if all are, the camera has only turned


@dataclass(frozen=True, eq=False)
class RelativePose:
    """Second camera from the first: `X2 = rotation @ X1 + d * translation`, plane `normal . X1 = d`.

    `translation` (3,) is t / d, in units of the plane's distance from the first camera; `normal` (3,) unit.
    """

    rotation: FloatArray
    translation: FloatArray
    normal: FloatArray


def relative_poses_from_homography(
    matrix: ArrayLike, rays: ArrayLike | None = None
) -> tuple[RelativePose, ...]:
    """Poses that explain a homography (3,3) with `ray2 ~ matrix @ ray1`.

    There are four, two with the plane on the other side; with `rays` (n,3) of the plane in the first camera
    only those remain in which both cameras see it, at most two. One alone, with zero translation and the
    normal open (NaN), where the camera has only turned.

    Raises
    ------
    PoseNotFound
        The matrix is singular: the plane goes through a camera.

    Source: Ma, Soatto, Kosecka and Sastry, An Invitation to 3-D Vision, 2004, ch. 5.3.
    """
    given = np.asarray(matrix, dtype=np.float64)
    scaled = _unit_scale(given)
    singular = np.linalg.svd(scaled, compute_uv=False)
    if singular[0] - singular[2] < _TURN_ONLY:
        return (RelativePose(scaled, np.zeros(3), np.full(3, np.nan)),)
    found = [pose for one in _decomposed(scaled) for pose in (one, _other_side(one))]
    if rays is None:
        return tuple(found)
    seen = np.asarray(rays, dtype=np.float64)
    return tuple(pose for pose in found if float(np.mean(seen @ pose.normal > 0)) > 0.5)


def _decomposed(matrix: FloatArray) -> list[RelativePose]:
    """Both poses with one orientation of the normal (one where both are the same), matrix at unit scale."""
    _, (largest, _, smallest), (v1, v2, v3) = np.linalg.svd(matrix)
    wide, narrow = np.sqrt(max(largest**2 - 1, 0.0)), np.sqrt(max(1 - smallest**2, 0.0))
    poses = []
    for sign in (1.0, -1.0) if min(wide, narrow) > _TURN_ONLY else (1.0,):
        # A direction that the map keeps in length, as it does v2: both span the plane's own directions.
        u = (narrow * v1 + sign * wide * v3) / np.hypot(wide, narrow)
        normal = np.cross(v2, u)
        before = np.stack([v2, u, normal], axis=1)
        moved = matrix @ v2, matrix @ u
        rotation = np.stack([*moved, np.cross(*moved)], axis=1) @ before.T
        poses.append(RelativePose(rotation, (matrix - rotation) @ normal, normal))
    return poses


def _other_side(pose: RelativePose) -> RelativePose:
    return RelativePose(pose.rotation, -pose.translation, -pose.normal)


def _unit_scale(given: FloatArray) -> FloatArray:
    """Homography at unit scale; PoseNotFound for a singular matrix, of whatever scale."""
    whole = given.shape == (3, 3) and bool(np.all(np.isfinite(given)))
    if not whole or not abs(np.linalg.det(given)) > _SINGULAR * np.linalg.norm(given) ** 3:
        raise PoseNotFound("This homography is singular: its plane goes through one of the cameras.")
    return unit_scale(given)


def relative_pose_of_upright_plane(
    matrix: ArrayLike, up1: ArrayLike, up2: ArrayLike, rays: ArrayLike | None = None
) -> RelativePose:
    """Pose from the homography of a vertical plane when both cameras know where up is: it is only one.

    `up1`, `up2` (3,) are the directions in the cameras' frames; `rays` (n,3) of the plane in the first
    camera, by default its viewing direction, tell on which side the plane is.
    Source: method.md 5.1, weak Manhattan; Saurer et al. 2012.

    Raises
    ------
    PoseNotFound
        The homography is singular or not that of a vertical plane.
    """
    z = np.array([0.0, 0.0, 1.0])
    level1, level2 = rotation_between(np.asarray(up1), z), rotation_between(np.asarray(up2), z)
    upright = level2 @ _unit_scale(np.asarray(matrix, dtype=np.float64)) @ level1.T
    # A vertical plane's normal has no z: the last column is that of a turn about z.
    upright = upright / np.linalg.norm(upright[:, 2])
    if upright[2, 2] < np.cos(np.radians(20)):
        raise PoseNotFound(
            "This is not the homography of a vertical plane between cameras with these verticals."
        )
    best: tuple[float, RelativePose] | None = None
    for angle in _turns(upright[:2, :2]):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        u, values, vt = np.linalg.svd((upright - turn)[:, :2])
        normal = np.array([*vt[0], 0.0])
        pose = RelativePose(level2.T @ turn @ level1, level2.T @ (u[:, 0] * values[0]), level1.T @ normal)
        if best is None or values[1] < best[0]:
            best = (float(values[1]), pose)
    if best is None:
        raise PoseNotFound(
            "This is not the homography of a vertical plane between cameras with these verticals."
        )
    seen = np.array([[0.0, 0.0, 1.0]]) if rays is None else np.asarray(rays, dtype=np.float64)
    return best[1] if float(np.mean(seen @ best[1].normal > 0)) > 0.5 else _other_side(best[1])


def _turns(block: FloatArray) -> list[float]:
    """Angles (rad) at which `block` (2,2) minus the turn has rank one: det(block) + 1 = a cos + b sin."""
    a, b = block[0, 0] + block[1, 1], block[1, 0] - block[0, 1]
    size = float(np.hypot(a, b))
    if size < 1e-12:
        return []
    opening = float(np.arccos(np.clip((np.linalg.det(block) + 1) / size, -1, 1)))
    middle = float(np.arctan2(b, a))
    return [middle - opening, middle + opening]
