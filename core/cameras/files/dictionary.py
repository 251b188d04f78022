"""Cameras as plain dictionaries, for the project file and for JSON files of their own.

    {"model": "perspective", "width": 6000, "height": 4000, "K": [[...], ...], "distortion": [k1, k2, ...]}

A distortion is a list in OpenCV's order, or a table (`radial`, `denominator`, `tangential`, `prism`) where
that order has no place for its terms. Pixels count from the centre of the top-left one.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import CameraError
from ..base import Camera
from ..catadioptric import CatadioptricCamera
from ..distortion import Distortion
from ..equirectangular import EquirectangularCamera
from ..fisheye import FisheyeCamera
from ..lens_models import DivisionCamera, ExtendedUnifiedCamera, FieldOfViewCamera, InverseRadialCamera
from ..perspective import PerspectiveCamera
from ..polynomial import PolynomialCamera
from .text import entry, number, read_text, whole, write_text


@dataclass(frozen=True)
class _Model:
    """A class with the attributes that its constructor takes after width and height: needed ones, others."""

    make: Callable[..., Camera]
    needed: tuple[str, ...] = ()
    others: tuple[str, ...] = ()


_MODELS = {
    "perspective": _Model(PerspectiveCamera, ("K",), ("distortion",)),
    "fisheye": _Model(FisheyeCamera, ("K",), ("coefficients", "distortion")),
    "polynomial": _Model(PolynomialCamera, ("centre", "coefficients"), ("stretch",)),
    "catadioptric": _Model(CatadioptricCamera, ("K", "xi"), ("distortion",)),
    "equirectangular": _Model(EquirectangularCamera, (), ("full_size", "offset")),
    "extended_unified": _Model(ExtendedUnifiedCamera, ("K", "alpha", "beta")),
    "division": _Model(DivisionCamera, ("K", "k")),
    "field_of_view": _Model(FieldOfViewCamera, ("K", "omega")),
    "inverse_radial": _Model(InverseRadialCamera, ("K", "k")),
}
_SINGLE = ("xi", "alpha", "beta", "k", "omega")
_FISHEYE_ARGUMENTS = {"coefficients": "distortion", "distortion": "plane_distortion"}


def camera_to_dict(camera: Camera) -> dict[str, Any]:
    """Plain numbers, strings and lists that `camera_from_dict` turns back into the same camera."""
    name = next((name for name, model in _MODELS.items() if type(camera) is model.make), None)
    if name is None:
        raise CameraError(f"A {type(camera).__name__} cannot be stored.")
    model = _MODELS[name]
    out: dict[str, Any] = {"model": name, "width": camera.width, "height": camera.height}
    for key in (*model.needed, *model.others):
        out[key] = _plain(getattr(camera, key))
    return out


def _plain(value: Any) -> Any:
    if isinstance(value, Distortion):
        try:
            return list(value.opencv)
        except CameraError:
            return {field.name: list(getattr(value, field.name)) for field in fields(value)}
    return np.asarray(value, dtype=np.float64).tolist()


def camera_from_dict(table: Mapping[str, Any], what: str = "camera") -> Camera:
    """Camera from the dictionary of `camera_to_dict`; entries with a default may be left out.

    Raises
    ------
    CameraError
        Missing, unknown or senseless entries; the text starts with `what`.
    """
    name = entry(table, "model", what)
    if name not in _MODELS:
        raise CameraError(f"{what}: the model '{name}' is not one of {', '.join(_MODELS)}.")
    model = _MODELS[name]
    unknown = set(table) - {"model", "width", "height", *model.needed, *model.others}
    if unknown:
        raise CameraError(f"{what}: a {name} camera has no '{sorted(unknown)[0]}'.")
    arguments: dict[str, Any] = {}
    for key in (*model.needed, *(key for key in model.others if key in table)):
        argument = _FISHEYE_ARGUMENTS.get(key, key) if name == "fisheye" else key
        arguments[argument] = _value(key, entry(table, key, what), what)
    size = [whole(entry(table, key, what), f"{what}: {key}") for key in ("width", "height")]
    try:
        return model.make(*size, **arguments)
    except CameraError as error:
        raise CameraError(f"{what}: {error}") from error


def _value(key: str, value: Any, what: str) -> Any:
    what = f"{what}: {key}"
    if key in _SINGLE:
        return number(value, what)
    if key == "distortion":
        if isinstance(value, Mapping):
            return _distortion_parts(value, what)
        return Distortion.from_opencv(_array(value, what))
    values = _array(value, what)
    return (
        (float(values[0]), float(values[1]))
        if key in ("full_size", "offset") and values.size == 2
        else values
    )


def _distortion_parts(table: Mapping[str, Any], what: str) -> Distortion:
    names = [field.name for field in fields(Distortion)]
    unknown = set(table) - set(names)
    if unknown:
        raise CameraError(f"{what}: '{sorted(unknown)[0]}' is not one of {', '.join(names)}.")
    parts = {key: tuple(_array(value, f"{what}: {key}").ravel().tolist()) for key, value in table.items()}
    if len(parts.get("tangential", (0, 0))) != 2 or len(parts.get("prism", (0, 0, 0, 0))) != 4:
        raise CameraError(f"{what}: 'tangential' has 2 numbers and 'prism' has 4.")
    return Distortion(**parts)


def _array(value: Any, what: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise CameraError(f"{what}: expected numbers.") from error
    if not np.all(np.isfinite(array)):
        raise CameraError(f"{what}: the numbers must be finite.")
    return array


def read_camera_json(path: Path | str) -> Camera:
    """Camera from a JSON file written by `write_camera_json`; CameraError if it makes no sense."""
    try:
        table = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise CameraError(f"{path} is not a complete JSON file ({error}).") from error
    return camera_from_dict(table, str(path))


def write_camera_json(path: Path | str, camera: Camera) -> None:
    """Write a camera as a JSON file; OutputError if the file cannot be written."""
    write_text(path, json.dumps(camera_to_dict(camera), indent=2) + "\n")
