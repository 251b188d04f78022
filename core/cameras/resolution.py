"""How fine a camera sees: metres per pixel on a surface, radians per pixel in a direction.

Both follow from the rows of the projection Jacobian: their cross product is the area of pixels that a unit of
area across it covers, whatever the camera model.
"""

from __future__ import annotations

import numpy as np

from ..arrays import ArrayLike, FloatArray
from .base import Camera


def ground_sample_distance(camera: Camera, points: ArrayLike, normals: ArrayLike) -> FloatArray:
    """Metres per pixel on a surface: the side of the square patch that fills one pixel's area.

    Parameters
    ----------
    camera
        Any camera.
    points
        (N,3) metres, camera frame.
    normals
        (N,3) surface normals in the camera frame, of either side and of any length but zero.

    Returns
    -------
    (N,) metres per pixel; infinite where the surface is seen edge on, NaN where the camera does not see it.
    The slant is in it: at 60 degrees off the normal it is the geometric mean of the distances along and
    across the slant, 1.41 times that of a wall seen straight.
    """
    across = np.asarray(normals, dtype=np.float64)
    density = np.abs(np.sum(_pixel_area(camera, points) * across, axis=-1)) / np.linalg.norm(across, axis=-1)
    with np.errstate(divide="ignore"):
        distance: FloatArray = 1 / np.sqrt(density)
    return distance


def pixel_solid_angle(camera: Camera, pixels: ArrayLike) -> FloatArray:
    """Solid angle of one pixel, (N,2) pixels -> (N,) steradians; NaN where the camera sees nothing."""
    rays = camera.unproject(pixels)
    density = np.abs(np.sum(_pixel_area(camera, rays) * rays, axis=-1))
    with np.errstate(divide="ignore"):
        angle: FloatArray = 1 / density
    return angle


def angular_resolution(camera: Camera, pixels: ArrayLike) -> FloatArray:
    """Radians per pixel, the mean over directions: (N,2) -> (N,); NaN where the camera sees nothing."""
    return np.sqrt(pixel_solid_angle(camera, pixels))


def _pixel_area(camera: Camera, points: ArrayLike) -> FloatArray:
    """Cross product of the Jacobian's rows: (N,3) camera frame -> (N,3), square pixels per square metre."""
    jacobian = camera.project_with_jacobian(points)[1]
    return np.cross(jacobian[..., 0, :], jacobian[..., 1, :])
