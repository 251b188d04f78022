"""A photo with its camera and pose, as pose refinement, texturing and the report take it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..arrays import BoolArray, ByteArray, FloatArray
from ..cameras.base import Camera
from ..geometry.rigid import camera_centre


@dataclass(frozen=True, eq=False)
class View:
    """A posed photo: `x_cam = rotation @ x_world + translation` (m).

    `image` is a path or an (H,W,3) uint8 RGB array; `mask` (H,W) is true where the photo may be used;
    `covariance` (6,6) is the pose's (see `pose.Pose`), when known.
    """

    camera: Camera
    rotation: FloatArray
    translation: FloatArray
    image: Path | str | ByteArray
    name: str = ""
    mask: BoolArray | None = None
    covariance: FloatArray | None = None

    @property
    def centre(self) -> FloatArray:
        """Camera centre (3,) in the world, metres."""
        return camera_centre(self.rotation, self.translation)
