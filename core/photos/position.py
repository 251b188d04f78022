"""Where a photo says that it was taken and where it looked, and how sure that is: satellites and compass."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..errors import PhotoError
from .exif import Exif
from .xmp import read_xmp

_HORIZONTAL = 5.0  # m: a receiver between buildings that does not tell its own deviation
_VERTICAL = 10.0  # m: heights are about twice as uncertain
_LEAST = 0.02  # m: no receiver is surer, between antenna and lens
_COMPASS, _MAGNETIC = 12.0, 20.0  # degrees: a phone's compass near buildings; with unknown declination
_LEVEL = 15.0, 4.0  # degrees: pitch and roll of a photo that is only known to be upright
_GIMBAL_HEADING, _GIMBAL = 4.0, 1.5  # degrees


@dataclass(frozen=True)
class Direction:
    """Where a camera looked: degrees, and their standard deviations.

    `heading` clockwise from true north, `pitch` up from the horizon, `roll` clockwise as the camera looks.
    `held` (a, b) is the direction of the stored pixels (u right, v down) that was up when roll is 0.
    """

    heading: float
    pitch: float = 0.0
    roll: float = 0.0
    held: tuple[float, float] = (0.0, -1.0)
    heading_sigma: float = _COMPASS
    pitch_sigma: float = _LEVEL[0]
    roll_sigma: float = _LEVEL[1]


@dataclass(frozen=True)
class Position:
    """Where a photo was taken (WGS 84): degrees, height m or NaN, standard deviations in m per axis.

    `direction` is None where the photo does not tell it.
    """

    latitude: float
    longitude: float
    height: float
    sigma: float
    height_sigma: float
    held: tuple[float, float] = (0.0, -1.0)
    direction: Direction | None = None

    @property
    def said(self) -> str:
        """How sure it is, in words."""
        told = self.direction
        direction = "no direction" if told is None else f"direction ± {told.heading_sigma:.2g}°"
        return f"Tells its place, ± {self.sigma:.2g} m, {direction}"


def read_position(path: Path | str, exif: Exif) -> Position | None:
    """Position from a photo's EXIF data, direction from its XMP packet or EXIF data; None without position.

    Raises PhotoError when the file cannot be read.
    """
    if exif.gps is None or not _is_fix(*exif.gps[:2]):
        return None
    try:
        numbers = read_xmp(path)
    except OSError as error:
        raise PhotoError(f"{path}: the photo cannot be read ({error.strerror or error})") from error
    sigma, height_sigma = _deviations(exif, numbers)
    held = exif.up or (0.0, -1.0)
    direction = _gimbal(numbers) or _compass(exif, held)
    return Position(*exif.gps, sigma, height_sigma, held, direction)


def _is_fix(latitude: float, longitude: float) -> bool:
    """Whether this is a place with a north; receivers without a fix write zeros, or what is no angle."""
    return (latitude, longitude) != (0.0, 0.0) and abs(latitude) < 89.9 and abs(longitude) <= 180


def _deviations(exif: Exif, numbers: Mapping[str, float]) -> tuple[float, float]:
    """Standard deviations (m) across and in height."""
    told = [numbers.get(f"RtkStd{axis}") for axis in ("Lon", "Lat", "Hgt")]
    east, north, up = told
    if east and north and up:  # kinematic positioning tells them in metres; 0 without correction
        return max(east, north, _LEAST), max(up, _LEAST)
    if exif.gps_sigma:
        return max(exif.gps_sigma, 1.0), 2 * max(exif.gps_sigma, 1.0)
    return _HORIZONTAL, _VERTICAL


def _gimbal(numbers: Mapping[str, float]) -> Direction | None:
    for prefix in ("Gimbal", "Camera"):
        names = [f"{prefix}{angle}Degree" for angle in ("Yaw", "Pitch", "Roll")]
        if all(name in numbers for name in names):
            heading, pitch, roll = (numbers[name] for name in names)
            return Direction(heading, pitch, roll, (0.0, -1.0), _GIMBAL_HEADING, _GIMBAL, _GIMBAL)
    return None


def _compass(exif: Exif, held: tuple[float, float]) -> Direction | None:
    if exif.heading is None or not math.isfinite(exif.heading):
        return None
    sigma = _COMPASS if exif.heading_is_true else _MAGNETIC
    return Direction(exif.heading, held=held, heading_sigma=sigma)
