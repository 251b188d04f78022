"""Photos as pixels: reading, linear light, sampling. (u, v) = (0, 0) is the centre of the top-left pixel."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from ...arrays import AnyArray, ArrayLike, ByteArray, Float32Array, FloatArray
from ...cameras.base import Camera
from ...cameras.equirectangular import EquirectangularCamera
from ...errors import PhotoError, TextureError
from ...photos.image import image_size, read_deep_image, read_image
from ...photos.view import View

_CHUNK = 1 << 14  # cv2.remap takes maps below 32767 in either direction


def check_views(views: Sequence[View]) -> None:
    """Raise TextureError or PhotoError when there is no view, or one that cannot be used.

    Photo files are not decoded: their size is read from the header.
    """
    if len(views) == 0:
        raise TextureError("There are no photos with a pose: solve or import camera poses first.")
    for number, view in enumerate(views):
        name = view_name(view, number)
        rotation = np.asarray(view.rotation, dtype=np.float64)
        translation = np.asarray(view.translation, dtype=np.float64)
        if not isinstance(view.camera, Camera):
            raise TextureError(f"{name}: the photo has no camera model.")
        if rotation.shape != (3, 3) or translation.shape != (3,):
            raise TextureError(f"{name}: a pose is a 3 x 3 rotation and a translation of 3 numbers.")
        if not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
            raise TextureError(f"{name}: the pose holds numbers that are not finite.")
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-5) or np.linalg.det(rotation) < 0:
            raise TextureError(f"{name}: the rotation is no rotation matrix (it stretches or mirrors).")
        if isinstance(view.image, np.ndarray):
            if view.image.ndim != 3 or view.image.shape[2] != 3:
                raise PhotoError(f"{name}: a photo needs three channels; this has shape {view.image.shape}.")
            _check_size(name, view.image.shape[1], view.image.shape[0], view.camera)
        else:
            _check_size(name, *image_size(view.image), view.camera)
        _check_mask(name, view)


def _check_mask(name: str, view: View) -> None:
    """Compare a mask's size with its photo's; that of a file is read from its header."""
    if view.mask is None:
        return
    if isinstance(view.mask, np.ndarray):
        height, width = view.mask.shape
    else:
        try:
            width, height = image_size(view.mask)
        except PhotoError as error:
            raise PhotoError(str(error).replace("photo", "mask")) from error
    if (width, height) != (view.camera.width, view.camera.height):
        raise PhotoError(
            f"{name}: the mask is {width} x {height} pixels, the photo {view.camera.width} x "
            f"{view.camera.height}; both must have the same size."
        )


def view_name(view: View, number: int) -> str:
    """Return the name a user knows a view by."""
    if view.name:
        return view.name
    return f"photo {number + 1}" if isinstance(view.image, np.ndarray) else Path(view.image).name


def read_photo(view: View, number: int = 0) -> ByteArray:
    """Pixels of a view's photo as stored, (H,W,3) uint8 RGB. Raises PhotoError."""
    image = view.image if isinstance(view.image, np.ndarray) else read_image(view.image)
    _check_size(view_name(view, number), image.shape[1], image.shape[0], view.camera)
    return image


def read_reduced_photo(view: View, largest: float) -> tuple[ByteArray, float]:
    """Pixels of a photo halved until it has at most `largest` pixels: (h,w,3) uint8 RGB, and the scale.

    Pixel (u, v) of the photo lies at `(u + 0.5) * scale - 0.5`. Raises PhotoError.
    """
    scale = 1.0
    while scale > 1 / 8 and view.camera.width * view.camera.height * scale**2 > largest:
        scale /= 2
    if not isinstance(view.image, np.ndarray):
        return read_image(view.image, scale), scale
    if scale == 1:
        return view.image, scale
    small = cv2.resize(view.image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return small.astype(np.uint8, copy=False), scale


def read_deep_photo(view: View, number: int = 0) -> AnyArray:
    """Pixels of a view's photo in its own depth: (H,W,3) uint8 or uint16, RGB. Raises PhotoError."""
    image = view.image if isinstance(view.image, np.ndarray) else read_deep_image(view.image)
    _check_size(view_name(view, number), image.shape[1], image.shape[0], view.camera)
    return image


def _check_size(name: str, width: int, height: int, camera: Camera) -> None:
    if (width, height) != (camera.width, camera.height):
        raise PhotoError(
            f"{name}: the photo is {width} x {height} pixels, but its camera is calibrated for "
            f"{camera.width} x {camera.height}; use the original photo or the right calibration."
        )


def full_turn(camera: Camera) -> float:
    """Pixels after which a photo repeats, for a panorama whose sides meet; 0 for any other photo."""
    if isinstance(camera, EquirectangularCamera) and abs(camera.turn - camera.width) < 0.5:
        return camera.turn
    return 0.0


def sample_image(image: AnyArray, pixels: ArrayLike, wraps: bool = False, cubic: bool = False) -> AnyArray:
    """Bilinear values at pixels, clamped to the frame: (H,W) or (H,W,C), (N,2) -> (N,) or (N,C).

    The values keep the image's type; OpenCV interpolates in steps of 1/32 pixel. An image that `wraps` goes
    on at its other side (see `full_turn`). `cubic` interpolation keeps the detail where values are stored.
    """
    at = np.asarray(pixels, dtype=np.float32)
    if wraps:
        at = np.asarray(pixels, dtype=np.float64)
        width, height = image.shape[1], image.shape[0]
        at = np.stack([np.mod(at[..., 0], width), np.clip(at[..., 1], 0, height - 1)], axis=-1)
        image = np.concatenate([image[:, -2:], image, image[:, :2]], axis=1)
        at = (at + np.array([2, 0])).astype(np.float32)
    count = len(at)
    if count == 0:
        return np.zeros((0, *image.shape[2:]), dtype=image.dtype)
    rows = -(-count // _CHUNK)
    padded = np.zeros((rows * _CHUNK if rows > 1 else count, 2), dtype=np.float32)
    padded[:count] = at
    grid = padded.reshape(rows, -1, 2)
    kernel = cv2.INTER_CUBIC if cubic else cv2.INTER_LINEAR
    values = cv2.remap(image, grid[..., 0], grid[..., 1], kernel, borderMode=cv2.BORDER_REPLICATE)
    out: AnyArray = values.reshape(-1, *image.shape[2:])[:count]
    return out


def to_linear(colours: AnyArray) -> Float32Array:
    """Linear light in [0, 1] of sRGB values: uint8, uint16 or float in [0, 1], any shape.

    Source: IEC 61966-2-1.
    """
    if colours.dtype == np.uint8:
        return _LINEAR_OF_BYTE[colours]
    s = colours.astype(np.float32) / np.float32(65535) if colours.dtype == np.uint16 else colours
    s = np.clip(s, 0, None).astype(np.float32)
    linear: Float32Array = np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4).astype(np.float32)
    return linear


def to_srgb(linear: Float32Array | FloatArray) -> Float32Array:
    """Values in sRGB, [0, 1], of linear light, any shape; input outside is clipped. Source: IEC 61966-2-1."""
    x = np.clip(linear, 0, 1).astype(np.float32)
    s: Float32Array = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055).astype(np.float32)
    return s


def to_bytes(srgb: Float32Array | FloatArray) -> ByteArray:
    """8-bit values of sRGB ones in [0, 1], rounded."""
    scaled = np.rint(np.clip(srgb, 0, 1).astype(np.float32) * np.float32(255))
    codes: ByteArray = scaled.astype(np.uint8)
    return codes


_CODES: FloatArray = np.arange(256, dtype=np.float64) / 255.0
_LINEAR_OF_BYTE: Float32Array = np.where(
    _CODES <= 0.04045, _CODES / 12.92, ((_CODES + 0.055) / 1.055) ** 2.4
).astype(np.float32)
