"""Masks of regions as files that other programs read."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ..arrays import ArrayLike
from ..errors import OutputError
from ..files import replacing


def write_mask(path: Path | str, mask: ArrayLike) -> None:
    """Write a mask (H,W) as an 8-bit PNG: 255 inside, 0 outside; the file is replaced only when complete."""
    pixels = (np.asarray(mask) != 0).astype(np.uint8) * 255
    done, data = cv2.imencode(".png", pixels)
    if not done:
        raise OutputError(f"{path}: a mask of {pixels.shape} pixels cannot be written as PNG")
    with replacing(path) as file:
        file.write(data.tobytes())
