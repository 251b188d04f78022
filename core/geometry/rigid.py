"""Rotations and rigid transforms. World to camera is `x_cam = R x_world + t` throughout."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..arrays import ArrayLike, FloatArray


def skew(v: ArrayLike) -> FloatArray:
    """Cross-product matrices: (...,3) -> (...,3,3) with `skew(a) @ b == cross(a, b)`."""
    v = np.asarray(v, dtype=np.float64)
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def exp_so3(w: ArrayLike) -> FloatArray:
    """Rotation matrices from rotation vectors: (...,3) rad -> (...,3,3). Source: Rodrigues' formula."""
    w = np.asarray(w, dtype=np.float64)
    angle2 = np.sum(w * w, axis=-1)[..., None, None]
    angle = np.sqrt(angle2)
    # np.sinc(x) = sin(pi x) / (pi x): exact at zero; (1 - cos) / angle^2 = sinc(angle / 2)^2 / 2.
    a = np.sinc(angle / np.pi)
    b = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    k = skew(w)
    out: FloatArray = np.eye(3) + a * k + b * (k @ k)
    return out


def log_so3(rotation: ArrayLike) -> FloatArray:
    """Rotation vectors from rotation matrices: (...,3,3) -> (...,3) rad, length in [0, pi]."""
    rotation = np.asarray(rotation, dtype=np.float64)
    vector: FloatArray = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_rotvec()
    return vector.reshape(rotation.shape[:-1])


def rotation_angle(rotation: ArrayLike) -> FloatArray:
    """Angle of rotation matrices: (...,3,3) -> (...) rad."""
    norm: FloatArray = np.linalg.norm(log_so3(rotation), axis=-1)
    return norm


def rotation_between(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Return the smallest rotation (3,3) that turns direction `a` (3,) into direction `b` (3,)."""
    a = np.asarray(a, dtype=np.float64) / np.linalg.norm(a)
    b = np.asarray(b, dtype=np.float64) / np.linalg.norm(b)
    axis = np.cross(a, b)
    sine, cosine = float(np.linalg.norm(axis)), float(a @ b)
    if sine < 1e-12:
        if cosine > 0:
            return np.eye(3)
        helper = np.eye(3)[np.argmin(np.abs(a))]  # opposite: half a turn about any normal
        axis = np.cross(a, helper)
        return exp_so3(np.pi * axis / np.linalg.norm(axis))
    return exp_so3(np.arctan2(sine, cosine) * axis / sine)


def camera_centre(rotation: ArrayLike, translation: ArrayLike) -> FloatArray:
    """Camera centre in the world: `c = -R^T t`, (3,3), (3,) -> (3,)."""
    centre: FloatArray = -np.asarray(rotation, dtype=np.float64).T @ np.asarray(translation, dtype=np.float64)
    return centre
