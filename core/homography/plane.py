"""The plane behind a homography when the cameras' relative pose is known."""

from __future__ import annotations

import numpy as np

from ..arrays import ArrayLike, FloatArray
from ..cameras.base import Camera
from ..errors import PoseNotFound
from ..regions import ImageRegion
from .views import region_view

_CONTRADICTION = 0.1  # of a region's spread, by which a plane may miss its homography
_GRID = 12  # rays along each side of a photo


def plane_from_homography(
    matrix: ArrayLike,
    camera1: Camera,
    camera2: Camera,
    rotation: ArrayLike,
    translation: ArrayLike,
    image_region1: ImageRegion | None = None,
) -> tuple[FloatArray, float]:
    """Plane `normal . X1 = distance` in the first camera's frame: unit normal (3,) and distance > 0.

    `ray2 ~ matrix @ ray1` as measured, `X2 = rotation @ X1 + translation` as known; the distance has the
    translation's unit. A homography is exact where it was measured: `image_region1` says where that was,
    otherwise the whole matrix counts.

    Raises
    ------
    PoseNotFound
        The cameras stand at one place, no plane before them gives this homography, or none does with this
        pose (told only where `image_region1` says where the homography is exact).

    Source: `matrix ~ R + t mᵀ` is linear in `m = n / d`: least squares of `H r x (R r + t m.r)` over rays, in
    place of the derivatives of method.md 5.2.
    """
    turn, shift = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64).ravel()
    if not np.linalg.norm(shift) > 0:
        raise PoseNotFound("Both cameras stand at one place: from there no distance can be told.")
    rays = _rays(camera1, image_region1)
    mapped = rays @ np.asarray(matrix, dtype=np.float64).T
    mapped /= np.linalg.norm(mapped, axis=1, keepdims=True)
    known = np.cross(mapped, rays @ turn.T)
    slope = np.cross(mapped, shift)[:, :, None] * rays[:, None, :]
    inverse_normal = np.linalg.lstsq(slope.reshape(-1, 3), -known.ravel(), rcond=None)[0]
    size = float(np.linalg.norm(inverse_normal))
    before = rays @ inverse_normal > 0
    carried = rays @ turn.T + np.outer(rays @ inverse_normal, shift)
    seen = np.all(np.isfinite(camera2.project(carried)), axis=1)
    if not size > 0 or not np.mean(before) > 0.5 or not np.any(before & seen):
        raise PoseNotFound("No plane before the cameras gives this homography with this pose between them.")
    if image_region1 is not None and _misfit(mapped, carried) > _CONTRADICTION:
        raise PoseNotFound(
            "The homography and the pose between the cameras contradict each other: check which of them is "
            "right."
        )
    normal: FloatArray = inverse_normal / size
    return normal, 1.0 / size


def _misfit(mapped: FloatArray, carried: FloatArray) -> float:
    """How far two bundles of rays (n,3), the first unit, lie apart, as a share of the first one's spread."""
    unit = carried / np.linalg.norm(carried, axis=1, keepdims=True)
    unit *= np.sign(np.sum(unit * mapped))  # a homography has no sign
    spread = np.sum((mapped - mapped.mean(axis=0)) ** 2)
    return float(np.sqrt(np.sum((mapped - unit) ** 2) / spread))


def _rays(camera: Camera, region: ImageRegion | None) -> FloatArray:
    """Rays (n,3) where a homography counts: of a region's outline and middle, or all over the photo."""
    if region is not None:
        view = region_view(camera, region)
        return np.concatenate([view.rays, view.middle[None]])
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, _GRID), np.linspace(0, camera.height - 1, _GRID))
    rays = camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1))
    seen: FloatArray = rays[np.all(np.isfinite(rays), axis=1)]
    return seen
