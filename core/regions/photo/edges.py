"""Edges of a photo at a working size: contrast made even, gradients, straight segments.

Pixels are those of the working image; the centre of its top-left pixel is (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import AnyArray, ArrayLike, ByteArray, Float32Array, FloatArray
from ...errors import RegionError

_NEIGHBOURHOOD = 24.0  # pixels (sigma) over which contrast is evened out
_CHROMA_BLUR = 1.5  # pixels (sigma): JPEG keeps hue at half resolution, in blocks
_FLOOR = (4.0, 8.0, 8.0)  # L*, a*, b* below which contrast counts as noise


@dataclass(frozen=True, eq=False)
class Gradient:
    """Gradient (H,W) of the evened-out colour, per pixel: `u` to the right, `v` down."""

    u: Float32Array
    v: Float32Array

    def at(self, points: FloatArray) -> FloatArray:
        """Gradients (...,2) at pixels (...,2), zero outside the image."""
        shape = points.shape[:-1]
        flat = points.reshape(-1, 2).astype(np.float32)
        rows = max(1, -(-len(flat) // 16384))  # cv2.remap takes at most 32767 in a row, and at least one
        padded = np.full((rows * 16384, 2), -10.0, dtype=np.float32)
        padded[: len(flat)] = flat
        u, v = padded.reshape(rows, 16384, 2).transpose(2, 0, 1).copy()
        out = np.empty((len(flat), 2))
        for axis, channel in enumerate((self.u, self.v)):
            out[:, axis] = cv2.remap(channel, u, v, cv2.INTER_LINEAR).ravel()[: len(flat)]
        return out.reshape(*shape, 2)


def as_photo(image: ArrayLike) -> ByteArray:
    """RGB photo (H,W,3) uint8 from a grey, RGB or RGBA one; raises RegionError for anything else."""
    pixels = np.asarray(image)
    if pixels.dtype != np.uint8 or pixels.ndim not in (2, 3) or min(pixels.shape[:2]) < 8:
        raise RegionError("The photo has to be an 8-bit image of at least 8 x 8 pixels.")
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[:, :, None], 3, axis=2)
    return np.ascontiguousarray(pixels[:, :, :3])


def reduced(image: ByteArray, longest: int) -> tuple[ByteArray, float]:
    """Photo with its longer side at most `longest` pixels, and its size relative to the original."""
    factor = min(1.0, longest / max(image.shape[:2]))
    if factor == 1.0:
        return image, 1.0
    size = (max(1, round(image.shape[1] * factor)), max(1, round(image.shape[0] * factor)))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8), size[0] / image.shape[1]


def to_reduced(pixels: ArrayLike, factor: float) -> FloatArray:
    """Pixels (...,2) of the photo as pixels of its reduced copy: corners coincide, not centres."""
    reduced_pixels: FloatArray = (np.asarray(pixels, dtype=np.float64) + 0.5) * factor - 0.5
    return reduced_pixels


def to_full(pixels: ArrayLike, factor: float) -> FloatArray:
    """Pixels (...,2) of a reduced copy as pixels of the photo."""
    full: FloatArray = (np.asarray(pixels, dtype=np.float64) + 0.5) / factor - 0.5
    return full


def lab(image: ByteArray) -> Float32Array:
    """CIELAB (H,W,3) of an sRGB photo: L* 0..100, a*, b*."""
    return cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2LAB).astype(np.float32)


def evened(colours: Float32Array) -> Float32Array:
    """Channels (H,W,k) of a CIELAB image, k = 1 or 3, less their local mean, in local standard deviations.

    An edge in shade counts like one in light.
    """
    even = np.empty_like(colours)
    for channel in range(colours.shape[2]):
        values = np.ascontiguousarray(colours[:, :, channel])
        if channel > 0:
            values = cv2.GaussianBlur(values, (0, 0), _CHROMA_BLUR).astype(np.float32)
        offset = values - _around(values)
        variance = np.maximum(_around(offset * offset), 0)
        even[:, :, channel] = offset / np.sqrt(variance + _FLOOR[channel] ** 2)
    return even


def _around(values: Float32Array) -> Float32Array:
    """Mean (H,W) over the neighbourhood; so wide a blur loses nothing on a quarter of the pixels' side."""
    height, width = values.shape
    small = max(1, -(-width // 4)), max(1, -(-height // 4))
    coarse = cv2.resize(values, small, interpolation=cv2.INTER_AREA)
    blurred = cv2.GaussianBlur(coarse, (0, 0), _NEIGHBOURHOOD * small[0] / width)
    return cv2.resize(blurred, (width, height), interpolation=cv2.INTER_LINEAR).astype(np.float32)


def gradient(even: Float32Array) -> Gradient:
    """Smoothed gradient of an evened image (H,W,k).

    At every pixel that of the channel where it is steepest.
    """
    steepest = np.full(even.shape[:2], -1, dtype=np.float32)
    u, v = np.empty_like(steepest), np.empty_like(steepest)
    for channel in range(even.shape[2]):
        smooth = cv2.GaussianBlur(even[:, :, channel], (0, 0), 0.8)
        along_u = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=0.125)
        along_v = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=0.125)
        steep = along_u * along_u + along_v * along_v
        steeper = steep > steepest
        for kept, new in ((steepest, steep), (u, along_u), (v, along_v)):
            np.copyto(kept, new, where=steeper)
    return Gradient(u, v)


def straight_segments(even: Float32Array) -> FloatArray:
    """Straight edge segments (N,4), u and v of both ends, of an evened lightness (H,W,1).

    Source: von Gioi, Jakubowicz, Morel and Randall, LSD: a fast line segment detector, PAMI 2010.
    """
    detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD)
    levels = np.clip(even[:, :, 0] * 50 + 128, 0, 255).astype(np.uint8)
    # typed as never None, but an image without edges has none
    segments: AnyArray | None = detector.detect(levels)[0]
    return np.zeros((0, 4)) if segments is None else np.asarray(segments, dtype=np.float64).reshape(-1, 4)
