"""Photo files as pixels: size from the header, decoding, completeness.

Pixels stay as they are stored: the orientation tag that viewers obey is ignored everywhere, because
calibration, masks and regions belong to the stored pixels (see `Exif.orientation_note`).
"""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np

from ..arrays import AnyArray, BoolArray, ByteArray
from ..errors import PhotoError
from .jpeg import jpeg_complete, jpeg_size
from .tiff import is_tiff, tiff_header

SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".jp2")
"""Photo formats, by lower-case file suffix."""

_HEAD = 1 << 20
"""Bytes that hold the header of any photo, its EXIF data and thumbnail included."""

_REDUCED = {2: cv2.IMREAD_REDUCED_COLOR_2, 4: cv2.IMREAD_REDUCED_COLOR_4, 8: cv2.IMREAD_REDUCED_COLOR_8}


def read_image(path: Path | str, scale: float = 1.0) -> ByteArray:
    """Pixels of a photo as stored, in 8 bits: (H,W,3) RGB.

    `scale` in (0, 1] reads it smaller: pixel (u, v) of the photo lies at `(u + 0.5) * scale - 0.5`, which is
    what `camera.scaled(scale)` expects. Raises PhotoError when the file is missing, incomplete or no photo.
    """
    if not 0 < scale <= 1:
        raise ValueError(f"scale must be in (0, 1], not {scale}")
    data = _read_complete(Path(path))
    # Only JPEG decodes smaller by itself and keeps the scale exact; of other formats OpenCV rounds the size.
    steps = (8, 4, 2) if data.startswith(b"\xff\xd8") else ()
    step = next((step for step in steps if scale * step <= 1), 1)
    flags = _REDUCED.get(step, cv2.IMREAD_COLOR) | cv2.IMREAD_IGNORE_ORIENTATION
    image = _decode(Path(path), data, flags)
    if scale * step < 1:
        # With factors instead of a size OpenCV keeps the scale exact where the size does not divide.
        factor = scale * step
        image = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    rgb: AnyArray = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    return rgb.astype(np.uint8, copy=False)


def read_deep_image(path: Path | str) -> AnyArray:
    """Pixels of a photo as stored, in its own depth: (H,W,3) RGB uint8 or uint16. Raises PhotoError."""
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    image = _decode(Path(path), _read_complete(Path(path)), flags)
    if image.dtype not in (np.uint8, np.uint16):
        raise PhotoError(f"{path}: pixels of type {image.dtype} are not supported; save 8 or 16 bits")
    deep: AnyArray = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    return deep


def image_size(path: Path | str) -> tuple[int, int]:
    """Width and height of the stored pixels, from the header where the format is JPEG, PNG or TIFF.

    Raises PhotoError when the file is missing or no photo.
    """
    path = Path(path)
    data = _read_bytes(path, _HEAD)
    if not data:
        raise _empty(path)
    size = _header_size(data)
    if size is None:
        height, width = _decode(path, _read_bytes(path), cv2.IMREAD_UNCHANGED).shape[:2]
        size = width, height
    if min(size) < 1:
        raise PhotoError(f"{path}: the photo has no pixels")
    return size


def read_transparency(path: Path | str) -> BoolArray | None:
    """Where a photo is opaque, (H,W), when it says so for its pixels (PNG, TIFF); None when all of it is.

    Raises PhotoError.
    """
    path = Path(path)
    if not _has_alpha(_read_bytes(path, _HEAD)):
        return None
    image = _decode(path, _read_complete(path), cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION)
    if image.ndim != 3 or image.shape[2] != 4:
        return None
    opaque: BoolArray = image[:, :, 3] > np.iinfo(image.dtype).max // 2
    return None if opaque.all() else opaque


def _has_alpha(data: bytes) -> bool:
    if data.startswith(b"\x89PNG\r\n\x1a\n") and len(data) > 25:
        return data[25] in (4, 6)  # colour types with alpha. Source: PNG 1.2, 4.1.1
    header = tiff_header(data) if is_tiff(data) else None
    return header is not None and header.has_alpha


def check_complete(path: Path | str, data: bytes | None = None) -> None:
    """Raise PhotoError when the file is missing, empty or cut off.

    The decoders fill the missing part of a JPEG or PNG with grey and say nothing. `data` may hold the file's
    bytes when they have been read already.
    """
    data = _read_bytes(Path(path)) if data is None else data
    if not data:
        raise _empty(path)
    cut_jpeg = data.startswith(b"\xff\xd8") and not jpeg_complete(data)
    cut_png = data.startswith(b"\x89PNG") and b"IEND" not in data[-4096:]
    if cut_jpeg or cut_png:
        raise PhotoError(f"{path}: the photo is cut off (its end is missing); copy it again from the camera")


def _empty(path: Path | str) -> PhotoError:
    return PhotoError(f"{path}: the photo file is empty; copy it again from the camera")


def _header_size(data: bytes) -> tuple[int, int] | None:
    if data.startswith(b"\xff\xd8"):
        return jpeg_size(data)
    if data.startswith(b"\x89PNG\r\n\x1a\n") and len(data) >= 24:
        width, height = struct.unpack_from(">II", data, 16)
        return int(width), int(height)
    header = tiff_header(data) if is_tiff(data) else None
    return (header.width, header.height) if header is not None else None


def _read_complete(path: Path) -> bytes:
    data = _read_bytes(path)
    check_complete(path, data)
    return data


def _read_bytes(path: Path, length: int = -1) -> bytes:
    # OpenCV cannot open every Unicode path on Windows: Python reads, OpenCV decodes.
    try:
        with path.open("rb") as file:
            return file.read(length)
    except FileNotFoundError:
        raise PhotoError(f"{path}: no such photo") from None
    except OSError as error:
        raise PhotoError(f"{path}: the photo cannot be read ({error.strerror or error})") from error


def _decode(path: Path, data: bytes, flags: int) -> AnyArray:
    header = tiff_header(data) if is_tiff(data) else None
    if header is not None and header.is_float:
        raise PhotoError(f"{path}: floating-point pixels are not supported; save the photo with 8 or 16 bits")
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error as error:
        raise PhotoError(f"{path}: the photo cannot be decoded ({error.err})") from error
    if image is None:
        raise PhotoError(f"{path}: not a photo that can be read, or it is damaged")
    decoded: AnyArray = image
    return decoded
