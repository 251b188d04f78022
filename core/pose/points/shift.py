"""How far a photo may lie off on the surface: the pose's uncertainty in millimetres where it matters."""

from __future__ import annotations

import numpy as np

from ...arrays import ArrayLike, FloatArray
from ...geometry.rigid import skew
from ..pose import Pose


def predicted_shift(pose: Pose, points: ArrayLike, normals: ArrayLike | None = None) -> FloatArray:
    """Standard deviation in mm of where the photo's content comes to lie at points of the surface.

    points (N,3) m, world; normals (N,3) of any length, or None for surfaces that face the camera. Returns
    (N,) mm, over both directions in the surface together; it grows with the slant, NaN for a point at the
    camera centre. Source: propagation of `pose.covariance` through `x_cam = R (X - c)`.
    """
    points = np.asarray(points, dtype=np.float64)
    ray = points - pose.centre
    distance = np.linalg.norm(ray, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        direction = ray / distance[:, None]
    facing = -direction if normals is None else np.asarray(normals, dtype=np.float64)
    # a pixel's ray goes through c + R^T r: a step (w, d) moves its end by d - R^T (w x r) = d + R^T (r x w)
    turned = np.swapaxes(pose.rotation[None], 1, 2) @ skew(ray @ pose.rotation.T)
    moved = np.concatenate([turned, np.broadcast_to(np.eye(3), (len(points), 3, 3))], axis=2)
    along = np.einsum("nk,nk->n", direction, facing)
    with np.errstate(divide="ignore", invalid="ignore"):
        onto_surface = np.eye(3) - direction[:, :, None] * (facing / along[:, None])[:, None, :]
    shift = onto_surface @ moved
    variance = np.einsum("nia,ab,nib->n", shift, pose.covariance, shift)
    out: FloatArray = 1000.0 * np.sqrt(variance)
    return out
