"""The distances at which a photo is sharp: by wavelet windows as published, and by its lens's settings.

Published: in windows of a single-level wavelet transform the detail bands' variances add up to the focus
measure; the distances of the scan seen in windows above a threshold are the depth of field. Source: method.md
4, step 2. The measure depends on what the photo shows, so a plain wall counts as blurred; `focus` compares
photos instead.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ...arrays import BoolArray, ByteArray, Float32Array, FloatArray
from ...photos.exif import Exif, read_exif
from ...photos.view import View
from ...settings import TextureSettings
from .focus import FocusModel
from .visibility import VisibleFaces

_WINDOW = 200.0
"""Side of the windows (pixels) in a photo of `_SENSOR` pixels; others scale with their resolution."""
_SENSOR = 24e6
_PERCENTILES = (5.0, 95.0)
_FARTHEST = 1e4
"""Focus distance (m) from which a lens counts as set to infinity."""


def window_measure(photo: ByteArray) -> Float32Array:
    """Focus measure `var(LH) + var(HL) + var(HH)` of each window: (H,W,3) -> (rows,columns), grey levels².

    Haar wavelet, orthonormal, one level. Source: method.md 4, step 2 (ch. 3.4.4).
    """
    grey = cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY)
    grey = grey[: grey.shape[0] // 2 * 2, : grey.shape[1] // 2 * 2].astype(np.float32)
    a, b, c, d = grey[::2, ::2], grey[::2, 1::2], grey[1::2, ::2], grey[1::2, 1::2]
    window = max(2.0, _WINDOW * np.sqrt(photo.shape[0] * photo.shape[1] / _SENSOR))
    rows, columns = (max(1, round(2 * side / window)) for side in a.shape)
    total = np.zeros((rows, columns), dtype=np.float32)
    for band in (a - b + c - d, a + b - c - d, a - b - c + d):
        detail = 0.5 * band
        mean, square = (
            np.asarray(cv2.resize(part, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.float32)
            for part in (detail, detail * detail)
        )
        total += square - mean * mean
    return total


def sharp_range(photo: ByteArray, seen: VisibleFaces, threshold: float) -> tuple[float, float]:
    """Nearest and farthest distance (m) seen in the windows of a photo (H,W,3) that are in focus.

    5th and 95th percentile over the faces seen there; (inf, 0) when no window is in focus.
    """
    measure = window_measure(photo)
    rows, columns = measure.shape
    at = (seen.centre + 0.5) * (columns / photo.shape[1], rows / photo.shape[0])
    column = np.clip(at[:, 0].astype(np.int64), 0, columns - 1)
    row = np.clip(at[:, 1].astype(np.int64), 0, rows - 1)
    focused = measure[row, column] > threshold
    if not focused.any():
        return np.inf, 0.0
    near, far = np.percentile(seen.distance[focused], _PERCENTILES)
    return float(near), float(far)


def in_depth_of_field(
    photo: ByteArray, view: View, seen: VisibleFaces, settings: TextureSettings
) -> BoolArray:
    """Faces within the published range and, where EXIF tells the lens's settings, within theirs: (n,)."""
    near, far = sharp_range(photo, seen, settings.focus_threshold)
    sharp: BoolArray = (seen.distance >= near) & (seen.distance <= far)
    lens = lens_focus(view)
    if lens is not None:
        sharp &= lens.blur(seen.distance) <= settings.focus_blur
    return sharp


def lens_focus(view: View) -> FocusModel | None:
    """Blur of a photo that its aperture, focal length and focus distance cause; None when EXIF lacks one."""
    if isinstance(view.image, np.ndarray) or not Path(view.image).is_file():
        return None
    middle = np.array([[(view.camera.width - 1) / 2, (view.camera.height - 1) / 2]])
    jacobian = view.camera.project_with_jacobian(view.camera.unproject(middle))[1][0]
    if not np.isfinite(jacobian).all():
        return None
    return focus_from_exif(read_exif(view.image), float(np.linalg.svd(jacobian, compute_uv=False)[0]))


def focus_from_exif(exif: Exif, focal_pixels: float) -> FocusModel | None:
    """Blur by distance from a lens's settings and its focal length in pixels; None when one is missing.

    The circle of confusion of a thin lens is `f² / N |1/d - 1/s|` for distances far beyond the focal length;
    a disc of that diameter has a standard deviation of a quarter of it along each axis.
    """
    if not (exif.aperture and exif.focus_distance and exif.focal_length):
        return None
    rate = exif.focal_length * 1e-3 * focal_pixels / exif.aperture / 4
    focus = 0.0 if exif.focus_distance > _FARTHEST else 1.0 / exif.focus_distance
    coefficients: FloatArray = rate**2 * np.array([focus**2, -2 * focus, 1.0])
    return FocusModel(coefficients)
