"""A camera pose and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray
from ..geometry.rigid import camera_centre


@dataclass(frozen=True, eq=False)
class Pose:
    """World to camera: `x_cam = rotation @ x_world + translation` (m).

    `covariance` (6,6) belongs to (w, centre): the left perturbation `exp(w) R` in radians along the camera
    axes, then the camera centre in metres along the world axes.
    """

    rotation: FloatArray
    translation: FloatArray
    covariance: FloatArray

    @property
    def centre(self) -> FloatArray:
        """Camera centre (3,) in the world, metres."""
        return camera_centre(self.rotation, self.translation)

    @property
    def rotation_sigma(self) -> float:
        """Standard deviation of the rotation in degrees, all axes together."""
        return float(np.degrees(np.sqrt(np.trace(self.covariance[:3, :3]))))

    @property
    def centre_sigma(self) -> float:
        """Standard deviation of the camera centre in metres, all axes together."""
        return float(np.sqrt(np.trace(self.covariance[3:, 3:])))
