"""Blender's images: files that stay files, and copies that are packed into the .blend."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import cv2
import numpy as np

from ...core.arrays import BoolArray, ByteArray
from ...core.errors import PhotoError, RegionError
from ...core.photos import read_mask

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


def encode_mask(mask: BoolArray) -> bytes:
    """PNG of a mask (H,W); touches no Blender data."""
    _, encoded = cv2.imencode(".png", mask.astype(np.uint8) * 255, [cv2.IMWRITE_PNG_BILEVEL, 1])
    return encoded.tobytes()


def pack_mask(name: str, encoded: bytes) -> bpy.types.Image:
    """Make a Blender image of a mask's PNG, packed into the .blend."""
    image = _pack(name, encoded)
    image.colorspace_settings.name = "Non-Color"
    return image


def _pack(name: str, data: bytes) -> bpy.types.Image:
    image = bpy.data.images.new(name, 1, 1)
    image.pack(data=data, data_len=len(data))
    image.source = "FILE"
    return image


@dataclass(frozen=True, eq=False)
class MaskSource:
    """Where a mask is stored, taken out of Blender so that threads can read it: file, bytes or pixels."""

    path: str = ""
    data: bytes = b""
    pixels: BoolArray | None = None

    def read(self) -> BoolArray:
        """Mask (H,W), true where it is bright. Raises RegionError when the file is missing or damaged."""
        if self.pixels is not None:
            return self.pixels
        if self.path:
            return read_mask(self.path)
        flags = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
        stored = cv2.imdecode(np.frombuffer(self.data, np.uint8), flags)
        if stored is None:
            raise RegionError("A mask in the .blend is damaged: remove it and mark the region again.")
        full = np.iinfo(stored.dtype).max if stored.dtype.kind in "iu" else 1.0
        bright: BoolArray = (stored if stored.ndim == 2 else stored[:, :, :3].max(axis=2)) > full / 2
        return bright


def mask_source(image: bpy.types.Image) -> MaskSource:
    """Return where a mask's image is stored; one that was painted on in Blender is read at once."""
    if image.is_dirty or image.source != "FILE":
        return MaskSource(pixels=_painted_mask(image))
    if image.packed_file is not None:
        return MaskSource(data=bytes(image.packed_file.data))
    return MaskSource(path=bpy.path.abspath(image.filepath))


def read_mask_pixels(image: bpy.types.Image) -> BoolArray:
    """Mask (H,W), true where an image is bright."""
    return mask_source(image).read()


def _painted_mask(image: bpy.types.Image) -> BoolArray:
    """Mask (H,W) of an image's pixels in Blender, whose first row is the bottom one; core's is the top."""
    width, height = image.size
    pixels = np.empty(width * height * image.channels, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    bright = pixels.reshape(height, width, image.channels)[..., : min(3, image.channels)].max(axis=2) > 0.5
    return np.ascontiguousarray(bright[::-1])
