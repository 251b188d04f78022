"""What a camera shows behind the scan: the photo as a pinhole camera would have taken it.

Blender's cameras have no lens distortion, so a photo that has some would not fit the scan behind it. Its
background is therefore an undistorted, smaller copy packed into the .blend; a photo without distortion is
shown itself. The original file is never touched.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ...core.arrays import ByteArray, FloatArray
from ...core.cameras import Camera
from ...core.jobs import Job, Progress
from ...core.photos import read_image
from .cameras import pinhole_matrix

LARGEST_BEND = 0.5  # px; below it the photo counts as undistorted
_ROWS = 64  # rows of the map made in one step


def is_straight(camera: Camera) -> bool:
    """Whether the photo is already as a pinhole camera would have taken it, to half a pixel."""
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 17), np.linspace(0, camera.height - 1, 17))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    seen = camera.project(_pinhole_rays(camera, pixels))
    return bool(np.all(np.abs(seen - pixels) < LARGEST_BEND))


def preview_job(path: Path, camera: Camera, size: int) -> Job[ByteArray | None]:
    """Read a photo as its pinhole camera would show it, the longer side about `size` pixels.

    None for a photo that needs no copy. Raises PhotoError when the file cannot be read.
    """
    if is_straight(camera):
        return None
    factor = min(1.0, size / max(camera.width, camera.height))
    yield Progress(0.0, f"Reading {path.name}")
    image = read_image(path, factor)
    small = camera.scaled(factor)
    where = np.empty((small.height, small.width, 2), dtype=np.float32)
    for row in range(0, small.height, _ROWS):
        yield Progress(0.4 + 0.6 * row / small.height, f"Undistorting {path.name}")
        v, u = np.mgrid[row : min(row + _ROWS, small.height), 0 : small.width]
        pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)
        seen = small.project(_pinhole_rays(small, pixels))
        where[row : row + _ROWS] = np.nan_to_num(seen, nan=-1e4).reshape(*u.shape, 2)
    return cv2.remap(image, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)


def _pinhole_rays(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Viewing rays (N,3) of pixels (N,2) through the pinhole camera."""
    K = pinhole_matrix(camera)
    plane = (pixels - K[:2, 2]) / np.diag(K)[:2]
    return np.column_stack([plane, np.ones(len(plane))])
