"""Blender's images: files that stay files, and copies that are packed into the .blend."""

from __future__ import annotations

from pathlib import Path

import bpy
import cv2
import numpy as np

from ...core.arrays import BoolArray, ByteArray
from ...core.errors import PhotoError, RegionError

JPEG_QUALITY = 88


def load_image(path: Path) -> bpy.types.Image:
    """Return Blender's image of a photo; a file that is there already is not loaded again."""
    try:
        return bpy.data.images.load(str(path), check_existing=True)
    except RuntimeError as error:
        raise PhotoError(f"{path}: Blender cannot read this photo") from error


def load_mask(path: Path) -> bpy.types.Image:
    """Return Blender's image of a mask file."""
    try:
        image = bpy.data.images.load(str(path), check_existing=True)
    except RuntimeError as error:
        raise RegionError(f"{path}: Blender cannot read this mask") from error
    image.colorspace_settings.name = "Non-Color"
    return image


def pack_photo(name: str, image: ByteArray) -> bpy.types.Image:
    """Make a Blender image of RGB pixels (H,W,3), as a JPEG packed into the .blend."""
    _, encoded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return _pack(name, encoded.tobytes())


def pack_mask(name: str, mask: BoolArray) -> bpy.types.Image:
    """Make a Blender image of a mask (H,W), as a PNG packed into the .blend."""
    _, encoded = cv2.imencode(".png", mask.astype(np.uint8) * 255)
    image = _pack(name, encoded.tobytes())
    image.colorspace_settings.name = "Non-Color"
    return image


def _pack(name: str, data: bytes) -> bpy.types.Image:
    image = bpy.data.images.new(name, 1, 1)
    image.pack(data=data, data_len=len(data))
    image.source = "FILE"
    return image


def read_mask_pixels(image: bpy.types.Image) -> BoolArray:
    """Mask (H,W), true where an image is bright; Blender's first row is the bottom one, core's the top."""
    width, height = image.size
    pixels = np.empty(width * height * image.channels, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    bright = pixels.reshape(height, width, image.channels)[..., : min(3, image.channels)].max(axis=2) > 0.5
    return np.ascontiguousarray(bright[::-1])
