"""What a camera shows behind the scan: the photo as a pinhole camera would have taken it.

Blender's cameras have no lens distortion, so a photo that has some would not fit the scan behind it. Its
background is therefore an undistorted, smaller copy packed into the .blend; a photo without distortion is
shown itself. The original file is never touched.
"""

from __future__ import annotations

import bpy
import cv2
import numpy as np

from ...core.arrays import ByteArray, FloatArray
from ...core.cameras import Camera
from ...core.jobs import Job, Progress
from .cameras import pinhole_matrix

LARGEST_BEND = 0.5  # px; below it the photo counts as undistorted
JPEG_QUALITY = 88
_ROWS = 64  # rows of the map made in one step


def is_straight(camera: Camera) -> bool:
    """Whether the photo is already as a pinhole camera would have taken it, to half a pixel."""
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 17), np.linspace(0, camera.height - 1, 17))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    seen = camera.project(_pinhole_rays(camera, pixels))
    return bool(np.all(np.abs(seen - pixels) < LARGEST_BEND))


def undistorted_job(image: ByteArray, camera: Camera, size: int) -> Job[ByteArray]:
    """Resample a photo (H,W,3) to its pinhole camera, the longer side at most `size` pixels."""
    factor = min(1.0, size / max(camera.width, camera.height))
    small = camera.scaled(factor) if factor < 1 else camera
    source = cv2.resize(image, (small.width, small.height), interpolation=cv2.INTER_AREA)
    yield Progress(0.1, "Undistorting")
    where = np.empty((small.height, small.width, 2), dtype=np.float32)
    for row in range(0, small.height, _ROWS):
        v, u = np.mgrid[row : min(row + _ROWS, small.height), 0 : small.width]
        pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)
        seen = small.project(_pinhole_rays(small, pixels))
        where[row : row + _ROWS] = np.nan_to_num(seen, nan=-1e4).reshape(*u.shape, 2)
        yield Progress(0.1 + 0.8 * row / small.height, "Undistorting")
    return cv2.remap(source, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)


def _pinhole_rays(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Viewing rays (N,3) of pixels (N,2) through the pinhole camera."""
    K = pinhole_matrix(camera)
    plane = (pixels - K[:2, 2]) / np.diag(K)[:2]
    return np.column_stack([plane, np.ones(len(plane))])


def pack_preview(name: str, image: ByteArray) -> bpy.types.Image:
    """Make a Blender image of RGB pixels (H,W,3), as a JPEG packed into the .blend."""
    _, encoded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    data = encoded.tobytes()
    block = bpy.data.images.new(name, image.shape[1], image.shape[0])
    block.pack(data=data, data_len=len(data))
    block.source = "FILE"
    return block
