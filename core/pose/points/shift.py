"""How far a photo may lie off on the surface: the pose's uncertainty in millimetres where it matters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import ArrayLike, Float32Array, FloatArray
from ...geometry.meshes import face_normals
from ...jobs import Job, Progress, drain
from ...photos.view import View
from ..pose import Pose

FACES = 1 << 17
"""Faces looked at in one step: bounds the memory and the time of a step."""


def predicted_shift(pose: Pose, points: ArrayLike, normals: ArrayLike | None = None) -> FloatArray:
    """Standard deviation in mm of where the photo's content comes to lie at points of the surface.

    points (N,3) m, world; normals (N,3) of any length, or None for surfaces that face the camera. Returns
    (N,) mm, over both directions in the surface together; it grows with the slant, NaN for a point at the
    camera centre. Source: propagation of `pose.covariance` through `x_cam = R (X - c)`.
    """
    ray = np.asarray(points, dtype=np.float64) - pose.centre
    facing = ray if normals is None else np.asarray(normals, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        slant = facing / np.einsum("nk,nk->n", ray, facing)[:, None]
    variance = np.zeros(len(ray))
    for step in _independent_steps(pose.covariance):
        # the ray through a pixel is c + R^T r: a step (w, d) moves its end by d + r x R^T w
        moved = step[3:] + np.cross(ray, pose.rotation.T @ step[:3])
        # and along the ray back to the surface
        moved -= np.einsum("nk,nk->n", moved, slant)[:, None] * ray
        variance += np.einsum("nk,nk->n", moved, moved)
    return 1000.0 * np.sqrt(variance)


def _independent_steps(covariance: FloatArray) -> FloatArray:
    """Steps (6,6), one a row, whose outer products add up to a covariance (6,6)."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    size, axis = np.linalg.eigh(covariance / np.outer(scale, scale))
    steps: FloatArray = (axis * np.sqrt(np.maximum(size, 0.0))).T * scale
    return steps


def predicted_face_shift(
    views: Sequence[View], vertices: ArrayLike, faces: ArrayLike, view_of_face: ArrayLike
) -> Float32Array:
    """Standard deviation in mm on the surface of where each face's photo lies, from the photo's pose.

    vertices (V,3) m, world; faces (F,3); view_of_face (F,): index of the view that textures each face, -1
    for none. Returns (F,), NaN where no photo sees the face or its view has no covariance. See
    `predicted_shift`.
    """
    return drain(predicted_face_shift_job(views, vertices, faces, view_of_face))


def predicted_face_shift_job(
    views: Sequence[View], vertices: ArrayLike, faces: ArrayLike, view_of_face: ArrayLike
) -> Job[Float32Array]:
    """Job of `predicted_face_shift`."""
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces)
    chosen = np.asarray(view_of_face)
    out = np.full(len(triangles), np.nan, dtype=np.float32)
    by_view = np.argsort(chosen, kind="stable")
    ends = np.searchsorted(chosen[by_view], np.arange(len(views) + 1))
    for number, view in enumerate(views):
        mine = by_view[ends[number] : ends[number + 1]]
        if view.covariance is None:
            continue
        pose = Pose(view.rotation, view.translation, view.covariance)
        for start in range(0, len(mine), FACES):
            yield Progress(ends[number] / max(len(chosen), 1), "Carrying the poses' uncertainty to the scan")
            part = mine[start : start + FACES]
            normals = face_normals(points, triangles[part])[0]
            out[part] = predicted_shift(pose, points[triangles[part]].mean(axis=1), normals)
    return out
