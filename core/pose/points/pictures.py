"""The pixels of a view at a chosen size."""

from __future__ import annotations

import cv2
import numpy as np

from ...arrays import BoolArray, ByteArray
from ...errors import PhotoError
from ...photos.image import read_image
from ...photos.view import View


def view_name(view: View, number: int) -> str:
    """Name of a view for the user: its own, or its place in the list."""
    return view.name or f"photo {number + 1}"


def read_view(view: View, scale: float = 1.0) -> ByteArray:
    """Pixels (H,W,3) RGB of a view's photo, reduced by `scale` as `camera.scaled(scale)` expects.

    Raises `PhotoError` when the photo cannot be read or its size is not the camera's.
    """
    if isinstance(view.image, np.ndarray):
        _check_size(view, view.image.shape[1], view.image.shape[0], 1.0)
        return view.image if scale == 1.0 else _reduced(view.image, scale)
    image = read_image(view.image, scale)
    _check_size(view, image.shape[1], image.shape[0], scale)
    return image


def read_view_mask(view: View, scale: float) -> BoolArray | None:
    """The view's mask reduced by `scale`; a reduced pixel is usable when all of it is."""
    mask = view.usable
    if mask is None:
        return None
    small = _reduced(np.where(mask, 255, 0).astype(np.uint8), scale)
    usable: BoolArray = small > 250
    return usable


def _reduced(image: ByteArray, scale: float) -> ByteArray:
    # factors instead of a size keep the scale exact where the size does not divide
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return small.astype(np.uint8, copy=False)


def _check_size(view: View, width: int, height: int, scale: float) -> None:
    expected = view.camera.width * scale, view.camera.height * scale
    if abs(width - expected[0]) > 1 or abs(height - expected[1]) > 1:
        name = view.name or "The photo"
        raise PhotoError(
            f"{name} is {round(width / scale)} x {round(height / scale)} pixels, its camera "
            f"{view.camera.width} x {view.camera.height}: use the camera of this photo's size."
        )
