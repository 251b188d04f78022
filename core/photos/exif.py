"""What the camera wrote into a photo: body, lens, focal length, orientation, position."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import exifread

from ..errors import PhotoError

logging.getLogger("exifread").setLevel(logging.CRITICAL)  # it reports photos without EXIF as warnings

_DIAGONAL_35MM = math.hypot(36.0, 24.0)
_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
"""Millimetres of the resolution units inch, cm, mm, µm."""

_TURNS = {
    2: "mirrored",
    3: "turned by 180°",
    4: "mirrored upside down",
    5: "mirrored and turned by 90°",
    6: "turned by 90° clockwise",
    7: "mirrored and turned by 90°",
    8: "turned by 90° anticlockwise",
}
_UP_IN_PIXELS = {1: (0.0, -1.0), 3: (0.0, 1.0), 6: (-1.0, 0.0), 8: (1.0, 0.0)}


@dataclass(frozen=True)
class Exif:
    """EXIF data of a photo; None where the photo does not say.

    Lengths in mm, `focus_distance` in m, `gps` (latitude, longitude in degrees, height in m or NaN),
    `gps_sigma` its horizontal error in m, `heading` where the camera looked, degrees clockwise from north:
    true north, or the compass'.
    `pixel_pitch` is the distance of sensor pixels in mm at the size `pixel_width` (focal plane resolution).
    """

    make: str = ""
    model: str = ""
    lens: str = ""
    serial: str = ""
    taken: str = ""
    focal_length: float | None = None
    focal_length_35mm: float | None = None
    aperture: float | None = None
    exposure_time: float | None = None
    iso: float | None = None
    focus_distance: float | None = None
    pixel_pitch: float | None = None
    pixel_width: int | None = None
    orientation: int = 1
    gps: tuple[float, float, float] | None = None
    gps_sigma: float | None = None
    heading: float | None = None
    heading_is_true: bool = False

    @property
    def up(self) -> tuple[float, float] | None:
        """Direction in the stored pixels (u right, v down) that the camera held up; None when not told."""
        return _UP_IN_PIXELS.get(self.orientation)

    def orientation_note(self, width: int, height: int) -> str:
        """Sentence for the user when viewers show the photo turned, else empty."""
        if self.orientation not in _TURNS:
            return ""
        return (
            f"Viewers show this photo {_TURNS[self.orientation]} (EXIF orientation {self.orientation}). "
            f"Fresco works on the pixels as stored, {width} x {height}: calibration, masks and regions have "
            "to be made for them."
        )

    def focal_pixels(self, width: int, height: int) -> tuple[float, str] | None:
        """Focal length in pixels and where it comes from, or None.

        The focal plane resolution belongs to the sensor and is exact to the focal length's rounding; the
        35 mm equivalent compares diagonals and is rounded to whole mm. Source: Exif 2.32, 4.6.5.
        """
        if self.focal_length and self.pixel_pitch and self.pixel_width:
            full = max(width, height)
            pixels = self.focal_length / self.pixel_pitch * full / self.pixel_width
            return pixels, f"EXIF focal length {self.focal_length:g} mm and sensor resolution"
        if self.focal_length_35mm:
            pixels = self.focal_length_35mm * math.hypot(width, height) / _DIAGONAL_35MM
            return pixels, f"EXIF 35 mm equivalent of {self.focal_length_35mm:g} mm, good to about 2 %"
        return None


def read_exif(path: Path | str) -> Exif:
    """Read the EXIF data of a photo; a photo without gives an empty `Exif`.

    Raises PhotoError when the file cannot be opened; damaged EXIF data counts as none.
    """
    try:
        with Path(path).open("rb") as file:
            return _exif(_tags(file))
    except OSError as error:
        raise PhotoError(f"{path}: the photo cannot be read ({error.strerror or error})") from error


def _tags(file: BinaryIO) -> Mapping[str, Any]:
    try:
        tags: Mapping[str, Any] = exifread.process_file(file, details=False)
    except Exception:  # exifread passes on whatever it meets in damaged data
        return {}
    return tags


def _exif(tags: Mapping[str, Any]) -> Exif:
    return Exif(
        make=_text(tags, "Image Make"),
        model=_text(tags, "Image Model"),
        lens=_text(tags, "EXIF LensModel"),
        serial=_text(tags, "EXIF BodySerialNumber"),
        taken=_text(tags, "EXIF DateTimeOriginal") or _text(tags, "Image DateTime"),
        focal_length=_positive(tags, "EXIF FocalLength"),
        focal_length_35mm=_positive(tags, "EXIF FocalLengthIn35mmFilm"),
        aperture=_positive(tags, "EXIF FNumber"),
        exposure_time=_positive(tags, "EXIF ExposureTime"),
        iso=_positive(tags, "EXIF ISOSpeedRatings"),
        focus_distance=_positive(tags, "EXIF SubjectDistance"),
        pixel_pitch=_pixel_pitch(tags),
        pixel_width=_longer_side(tags),
        orientation=int(_positive(tags, "Image Orientation") or 1),
        gps=_gps(tags),
        gps_sigma=_positive(tags, "GPS GPSHPositioningError") or _positive(tags, "GPS Tag 0x001F"),
        heading=next(iter(_numbers(tags, "GPS GPSImgDirection")), None),
        heading_is_true=_text(tags, "GPS GPSImgDirectionRef").upper() == "T",
    )


def _text(tags: Mapping[str, Any], name: str) -> str:
    return str(tags[name]).strip("\x00 ") if name in tags else ""


def _numbers(tags: Mapping[str, Any], name: str) -> list[float]:
    """Values of a tag as floats; fractions with denominator 0 are left out."""
    values = getattr(tags.get(name), "values", [])
    numbers = []
    for value in values if isinstance(values, (list, tuple)) else [values]:
        try:
            numbers.append(float(value))
        except (TypeError, ValueError, ZeroDivisionError):
            continue
    return numbers


def _positive(tags: Mapping[str, Any], name: str) -> float | None:
    numbers = _numbers(tags, name)
    return numbers[0] if numbers and math.isfinite(numbers[0]) and numbers[0] > 0 else None


def _pixel_pitch(tags: Mapping[str, Any]) -> float | None:
    resolution = _positive(tags, "EXIF FocalPlaneXResolution")
    unit = _UNIT_MM.get(int(_positive(tags, "EXIF FocalPlaneResolutionUnit") or 2))
    return unit / resolution if resolution and unit else None


def _longer_side(tags: Mapping[str, Any]) -> int | None:
    sides = [_positive(tags, f"EXIF ExifImage{side}") for side in ("Width", "Length")]
    return int(max(side for side in sides if side)) if all(sides) else None


def _gps(tags: Mapping[str, Any]) -> tuple[float, float, float] | None:
    angles = []
    for name in ("Latitude", "Longitude"):
        parts = _numbers(tags, f"GPS GPS{name}")
        if len(parts) != 3:
            return None
        sign = -1.0 if _text(tags, f"GPS GPS{name}Ref").upper() in ("S", "W") else 1.0
        angles.append(sign * (parts[0] + parts[1] / 60 + parts[2] / 3600))
    height = _numbers(tags, "GPS GPSAltitude")
    below = _numbers(tags, "GPS GPSAltitudeRef")[:1] == [1.0]
    return angles[0], angles[1], (-height[0] if below else height[0]) if height else math.nan
