"""Nominal cameras from sensor size, focal length and projection; the facts stand in presets/cameras.toml."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from ..arrays import FloatArray
from ..errors import CameraError
from .base import Camera
from .catadioptric import CatadioptricCamera
from .equirectangular import EquirectangularCamera
from .fisheye import FisheyeCamera
from .lens_models import ExtendedUnifiedCamera
from .perspective import PerspectiveCamera

_FILE = Path(__file__).parents[2] / "presets" / "cameras.toml"
_FOCAL_TOLERANCE = 0.05
"""Relative difference at which a phone's focal length still belongs to the same lens."""

_EQUISOLID = tuple((-1) ** n / (4**n * math.factorial(2 * n + 1)) for n in range(1, 7))
"""Series of 2 sin(t/2) = t + k1 t^3 + ..., off by less than 2e-9 everywhere."""


@dataclass(frozen=True)
class Body:
    """A camera body as its photos name it in their EXIF data."""

    make: str
    model: str
    sensor_mm: tuple[float, float] | None
    """Long and short side of the sensor, or None for stitched panoramas."""
    focal_mm: float | None = None
    """Focal length that the sensor belongs to, where a device has several cameras."""

    @property
    def is_panoramic(self) -> bool:
        """Whether the camera writes equirectangular panoramas."""
        return self.sensor_mm is None


def body_for(make: str, model: str, focal_mm: float | None = None) -> Body | None:
    """Body with an EXIF make and model (letter case and blanks do not matter), or None if it is not listed.

    A phone is found only for the focal length of the camera whose sensor is listed.
    """
    found = _bodies().get((_key(make), _key(model)))
    if found is None or found.focal_mm is None:
        return found
    if focal_mm is None or abs(focal_mm / found.focal_mm - 1) > _FOCAL_TOLERANCE:
        return None
    return found


def sensor_width_for(make: str, model: str, focal_mm: float | None = None) -> float | None:
    """Long side of the sensor in mm for an EXIF make and model, or None if it is not known."""
    body = body_for(make, model, focal_mm)
    return None if body is None or body.sensor_mm is None else body.sensor_mm[0]


def projection_for(lens: str) -> str | None:
    """Nominal projection of a lens by its (EXIF) name, or None if it is not listed."""
    return _lenses().get(_key(lens))


def preset_names() -> list[str]:
    """Names of all bodies that `camera_from_preset` knows, sorted."""
    return sorted({body.model for body in _bodies().values()})


def camera_from_preset(
    name: str, width: int, height: int, focal_mm: float, projection: str = "perspective"
) -> Camera:
    """Nominal camera: centred, square pixels, no distortion.

    Parameters
    ----------
    name
        EXIF model of the body, with or without its make before it.
    width, height
        Size of the photo in pixels, landscape or portrait; a cropped photo keeps the full long or short side.
    focal_mm
        True (not 35 mm equivalent) focal length; without meaning for panoramas.
    projection
        perspective, stereographic, equidistant, equisolid or orthographic, or the name of a listed lens.

    Raises
    ------
    CameraError
        Unknown body or projection, no positive focal length, a panorama that is not twice as wide as high.
    """
    body = _body_by_name(name, focal_mm)
    if body.sensor_mm is None:
        if width != 2 * height:
            raise CameraError(
                f"A panorama of {name} is twice as wide as high, not {width} x {height} pixels."
            )
        return EquirectangularCamera(width, height)
    if not (math.isfinite(focal_mm) and focal_mm > 0):
        raise CameraError(f"The focal length must be a positive number of millimetres, not {focal_mm}.")
    long_side, short_side = max(width, height), min(width, height)
    # Cropping shortens one side only: the other tells the pixel size, and it gives the smaller one.
    pitch = min(body.sensor_mm[0] / long_side, body.sensor_mm[1] / short_side)
    return nominal_camera(width, height, focal_mm / pitch, projection)


def nominal_camera(width: int, height: int, focal: float, projection: str = "perspective") -> Camera:
    """Centred camera of a focal length in pixels and a projection (see `camera_from_preset`)."""
    known = projection if projection in _PROJECTIONS else projection_for(projection)
    if known is None:
        raise CameraError(f"'{projection}' is neither a listed lens nor one of {', '.join(_PROJECTIONS)}.")
    K = np.array([[focal, 0, width / 2 - 0.5], [0, focal, height / 2 - 0.5], [0, 0, 1]])
    return _PROJECTIONS[known](width, height, K)


def _stereographic(width: int, height: int, K: FloatArray) -> Camera:
    # The unified sphere with xi = 1 is tan(t/2).
    return CatadioptricCamera(width, height, np.array([[2, 1, 1], [1, 2, 1], [1, 1, 1]]) * K, 1.0)


_PROJECTIONS: dict[str, Callable[[int, int, FloatArray], Camera]] = {
    "perspective": PerspectiveCamera,
    "stereographic": _stereographic,
    "equidistant": FisheyeCamera,
    "equisolid": lambda width, height, K: FisheyeCamera(width, height, K, _EQUISOLID),
    "orthographic": lambda width, height, K: ExtendedUnifiedCamera(width, height, K, 1.0, 1.0),
}


def _body_by_name(name: str, focal_mm: float) -> Body:
    wanted = _key(name)
    for (make, model), body in _bodies().items():
        if wanted in (model, make + model):
            if body.focal_mm is not None and body_for(body.make, body.model, focal_mm) is None:
                raise CameraError(
                    f"The sensor of {name} is known for its {body.focal_mm:g} mm camera, "
                    f"not for {focal_mm:g} mm."
                )
            return body
    raise CameraError(
        f"'{name}' is not in the list of camera bodies: give the sensor width or a calibration."
    )


def _key(text: str) -> str:
    return "".join(text.split()).casefold()


@cache
def _bodies() -> dict[tuple[str, str], Body]:
    table = tomllib.loads(_FILE.read_text(encoding="utf-8"))
    bodies = {}
    for group in table["body"]:
        sensor = tuple(group["sensor_mm"]) if "sensor_mm" in group else None
        for model in group["models"]:
            body = Body(group["make"], model, sensor, group.get("focal_mm"))
            bodies[_key(body.make), _key(model)] = body
    return bodies


@cache
def _lenses() -> dict[str, str]:
    table = tomllib.loads(_FILE.read_text(encoding="utf-8"))
    return {_key(name): group["projection"] for group in table["lens"] for name in group["names"]}
