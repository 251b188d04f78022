"""What a photo shows on the faces it sees: colours, burnt-out parts."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import AnyArray, ByteArray, Float32Array
from ...settings import TextureSettings
from .images import sample_image
from .visibility import VisibleFaces, triangle_areas

_SMALLEST = 1 / 16
"""Smallest scale at which a photo is sampled."""
_SIZED = 10_000
"""Faces whose size decides at which scale."""


@dataclass(frozen=True, eq=False)
class PhotoSamples:
    """What a photo shows on each of n faces: `colour` (n,3) sRGB, `clipped` (n,) share of burnt-out area."""

    colour: ByteArray
    clipped: Float32Array


def sample_photo(
    photo: ByteArray, scale: float, seen: VisibleFaces, settings: TextureSettings
) -> PhotoSamples:
    """Mean colour and burnt-out share of each face in a photo (H,W,3) read at `scale`."""
    some = seen.uv[:: max(1, len(seen) // _SIZED)]
    side = scale * float(np.sqrt(np.median(triangle_areas(some))))
    factor = float(np.clip(0.5 ** np.floor(np.log2(max(side, 1.0))), _SMALLEST, 1))
    at = (seen.centre + 0.5) * (scale * factor) - 0.5
    # One pass over the photo: inRange tells where all channels are below the level.
    limit = np.full(3, settings.clipped_level - 1)
    unburnt = np.asarray(cv2.inRange(photo, np.zeros(3), limit.astype(np.float64)))
    clipped = 1 - sample_image(_reduced(unburnt, factor), at).astype(np.float32) / np.float32(255)
    return PhotoSamples(sample_image(_reduced(photo, factor), at), clipped)


def _reduced(image: AnyArray, scale: float) -> AnyArray:
    if scale == 1:
        return image
    # Factors instead of a size keep the scale exact where the size does not divide.
    small: AnyArray = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return small
