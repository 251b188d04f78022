"""A photo with its camera and pose, as pose refinement, texturing and the report take it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arrays import BoolArray, ByteArray, FloatArray
from ..cameras.base import Camera
from ..geometry.rigid import camera_centre
from .image import read_transparency
from .marks import check_mask, read_mask


@dataclass(frozen=True, eq=False)
class View:
    """A posed photo: `x_cam = rotation @ x_world + translation` (m).

    `image` is a path or an (H,W,3) uint8 RGB array; `mask` (H,W) is true where the photo may be used, or the
    path of an image that is bright there, which keeps the masks of hundreds of photos out of memory (see
    `usable`); `covariance` (6,6) is the pose's (see `pose.Pose`), when known.
    """

    camera: Camera
    rotation: FloatArray
    translation: FloatArray
    image: Path | str | ByteArray
    name: str = ""
    mask: BoolArray | Path | str | None = None
    covariance: FloatArray | None = None

    @property
    def centre(self) -> FloatArray:
        """Camera centre (3,) in the world, metres."""
        return camera_centre(self.rotation, self.translation)

    @property
    def usable(self) -> BoolArray | None:
        """Where the photo may be used, (H,W): in its mask and where it is opaque; None: everywhere.

        Raises RegionError for a mask that is missing, damaged, empty or of another size than the camera;
        PhotoError for a photo that cannot be read.
        """
        opaque = None if isinstance(self.image, np.ndarray) else read_transparency(self.image)
        if self.mask is None:
            return opaque
        if isinstance(self.mask, np.ndarray):
            mask = self.mask
        else:
            mask = read_mask(self.mask)
            check_mask(mask, self.camera.width, self.camera.height, str(self.mask))
        return mask if opaque is None else mask & opaque
