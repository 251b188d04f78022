"""The camera of a photo from numbers or from its EXIF data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import FloatArray
from ..cameras import Camera, PerspectiveCamera
from ..cameras.presets import body_for, camera_from_preset, projection_for
from ..errors import CameraError
from .exif import Exif

PROJECTIONS = ("perspective", "stereographic", "equidistant", "equisolid", "orthographic")
"""Projections of a lens that can be named instead of it."""


def camera_matrix(
    width: int, height: int, focal: float | Sequence[float], principal: Sequence[float] | None = None
) -> FloatArray:
    """Camera matrix (3,3) in pixels from one or two focal lengths (pixels) and the principal point (u, v).

    Without a principal point it is the middle of the photo, ((width - 1) / 2, (height - 1) / 2): the centre
    of the top-left pixel is (0, 0).
    """
    fx, fy = (focal[0], focal[1]) if isinstance(focal, Sequence) else (focal, focal)
    u, v = principal if principal is not None else ((width - 1) / 2, (height - 1) / 2)
    return np.array([[fx, 0.0, u], [0.0, fy, v], [0.0, 0.0, 1.0]])


def focal_from_sensor(focal_mm: float, sensor_width_mm: float, width: int, height: int) -> float:
    """Focal length in pixels from mm; the sensor's width lies along the longer side of the photo.

    Raises CameraError for lengths that are not positive.
    """
    if focal_mm <= 0 or sensor_width_mm <= 0:
        raise CameraError(
            f"focal length {focal_mm:g} mm and sensor width {sensor_width_mm:g} mm have to be positive"
        )
    return focal_mm / sensor_width_mm * max(width, height)


def camera_from_exif(exif: Exif, width: int, height: int) -> tuple[Camera, str]:
    """Camera without distortion from EXIF data, and a sentence on how good it is.

    A listed body gives the sensor's size, a listed lens its projection; otherwise the photo has to tell its
    focal length and the camera is perspective. Raises CameraError when it does not.
    """
    body = body_for(exif.make, exif.model, exif.focal_length)
    if body is not None and (body.is_panoramic or exif.focal_length):
        return camera_from_body(body.model, width, height, exif.focal_length or 0.0, exif.lens)
    found = exif.focal_pixels(width, height)
    if found is None:
        raise CameraError(
            "the photo does not tell its focal length (no listed camera, no EXIF focal length with sensor "
            "resolution, no 35 mm equivalent); give a preset, a calibration file or numbers"
        )
    focal, source = found
    note = f"Focal length {focal:.0f} px from {source}; no lens distortion known."
    return PerspectiveCamera(width, height, camera_matrix(width, height, focal)), note


def camera_from_body(
    model: str, width: int, height: int, focal_mm: float, lens: str = ""
) -> tuple[Camera, str]:
    """Nominal camera of a listed body and a focal length in mm, and a sentence on it.

    `lens` is the name of a lens or a projection; an unlisted one counts as perspective. Raises CameraError
    for an unlisted body.
    """
    projection = (projection_for(lens) or "perspective") if lens not in PROJECTIONS else lens
    camera = camera_from_preset(model, width, height, focal_mm, projection)
    told = "a panorama" if focal_mm <= 0 else f"{focal_mm:g} mm, {projection}"
    return camera, f"Nominal camera of {model}, {told}; no lens distortion known."
