"""Points seen by a central camera: residuals in pixels that need no image plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import BoolArray, FloatArray
from ...cameras.base import Camera
from .perturbation import Linearisation, camera_point_jacobian, camera_points


@dataclass(frozen=True, eq=False)
class Sightings:
    """Pixels of points with known coordinates.

    `rays` (N,3) unit, camera frame; `to_pixels` (N,2,3) turns a small change of the viewing direction into
    pixels (the derivative of the projection at the ray). The residual `to_pixels @ (direction - ray)` equals
    the reprojection error to first order, has no seam in a panorama and no failure behind the camera.
    """

    rays: FloatArray
    to_pixels: FloatArray
    points: FloatArray

    def __len__(self) -> int:
        return len(self.rays)

    def select(self, chosen: BoolArray) -> Sightings:
        """Return the sightings at `chosen` (N,)."""
        return Sightings(self.rays[chosen], self.to_pixels[chosen], self.points[chosen])

    def residuals(self, rotation: FloatArray, centre: FloatArray) -> FloatArray:
        """Reprojection errors (N,2) in pixels for a pose (3,3), (3,)."""
        in_camera = camera_points(rotation, centre, self.points)
        return reprojection(self.rays, self.to_pixels, in_camera)[0]

    def linearise(self, rotation: FloatArray, centre: FloatArray) -> Linearisation:
        """Reprojection errors (N,2) and their derivative (N,2,6) by the pose step."""
        in_camera = camera_points(rotation, centre, self.points)
        residuals, by_point = reprojection(self.rays, self.to_pixels, in_camera)
        return residuals, by_point @ camera_point_jacobian(rotation, in_camera)


def reprojection(
    rays: FloatArray, to_pixels: FloatArray, in_camera: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Reprojection errors (N,2) px of camera points (N,3) seen along rays; derivative (N,2,3) by them."""
    distance = np.linalg.norm(in_camera, axis=1)
    direction = in_camera / distance[:, None]
    residuals: FloatArray = np.einsum("nij,nj->ni", to_pixels, direction - rays)
    along = np.einsum("nij,nj->ni", to_pixels, direction)
    by_point: FloatArray = (to_pixels - along[:, :, None] * direction[:, None, :]) / distance[:, None, None]
    return residuals, by_point


def sightings_from_pixels(camera: Camera, pixels: FloatArray, points: FloatArray) -> Sightings:
    """Sightings of points (N,3) at pixels (N,2); pixels outside the camera's model give NaN rays."""
    rays = camera.unproject(pixels)
    _, to_pixels = camera.project_with_jacobian(rays)
    return Sightings(rays, to_pixels, points)
