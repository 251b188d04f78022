"""`sfm_data` JSON files of OpenMVG and of AliceVision (Meshroom).

Both store a rotation world -> camera with OpenCV's axes and the camera's centre. Their pixels count from
the centre of the top-left one, as their features do. AliceVision writes matrices by columns, numbers as
strings, and since version 1.2.1 the principal point from the middle of the photo.
Source: the programs' own serialisation, AliceVision's versions 1.0 to 1.2.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import ByteArray, FloatArray
from ...errors import CameraError
from ..base import Camera
from ..distortion import Distortion
from ..equirectangular import EquirectangularCamera
from ..files.text import entry, number, numbers, read_text, whole
from ..fisheye import FisheyeCamera
from ..lens_models import FieldOfViewCamera
from ..perspective import PerspectiveCamera
from .reconstruction import PosedCamera, Reconstruction, checked_rotation, pose_from_centre

_UNDEFINED = 2**32 - 1


def read_sfm_data(path: Path | str) -> Reconstruction:
    """Cameras, poses and points of an `sfm_data.json` of OpenMVG or a `.sfm` / `.json` of AliceVision.

    Raises
    ------
    CameraError
        A broken file, rigs, or camera models that are not central or not known.
    """
    try:
        table = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise CameraError(f"{path} is not a complete JSON file ({error}).") from error
    if not isinstance(table, dict) or "views" not in table:
        raise CameraError(f"{path} has no views: it is not an sfm_data file.")
    return (
        _read_openmvg(table, str(path))
        if "sfm_data_version" in table
        else _read_alicevision(table, str(path))
    )


def _read_openmvg(table: Mapping[str, Any], path: str) -> Reconstruction:
    names: dict[int, str] = {}
    cameras = {
        int(item["key"]): _openmvg_camera(entry(item, "value", path), names, path)
        for item in _items(table, "intrinsics", path)
    }
    poses = {int(item["key"]): _openmvg_pose(item, path) for item in _items(table, "extrinsics", path)}
    posed, unposed = [], []
    for item in _items(table, "views", path):
        view = _data(entry(item, "value", path), path)
        name = str(entry(view, "filename", path))
        pose, camera = poses.get(int(view.get("id_pose", _UNDEFINED))), view.get("id_intrinsic", _UNDEFINED)
        if pose is None:
            unposed.append(name)
        elif camera not in cameras:
            raise CameraError(f"{path}: {name} has a pose but no camera.")
        else:
            posed.append(PosedCamera(name, cameras[camera], *pose))
    rows = [entry(entry(item, "value", path), "X", path) for item in _items(table, "structure", path)]
    points = np.array([numbers(row, f"{path}: structure", 3) for row in rows]).reshape(-1, 3)
    return Reconstruction(tuple(posed), points, unposed=tuple(unposed))


def _items(table: Mapping[str, Any], key: str, path: str) -> list[Mapping[str, Any]]:
    items = table.get(key) or []
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise CameraError(f"{path}: '{key}' must be a list of tables.")
    return items


def _data(value: Mapping[str, Any], path: str) -> dict[str, Any]:
    """Entries of an object as OpenMVG's serialisation wraps them, inherited ones included."""
    data = dict(entry(entry(value, "ptr_wrapper", path), "data", path))
    while isinstance(data.get("value0"), dict):
        data = {**data.pop("value0"), **data}
    return data


def _openmvg_pose(item: Mapping[str, Any], path: str) -> tuple[FloatArray, FloatArray]:
    value = entry(item, "value", path)
    what = f"{path}: extrinsics {item.get('key')}"
    rotation = numbers([v for row in entry(value, "rotation", what) for v in row], what, 9)
    return pose_from_centre(checked_rotation(rotation, what), numbers(entry(value, "center", what), what, 3))


def _openmvg_camera(value: Mapping[str, Any], names: dict[int, str], path: str) -> Camera:
    # A model is named where it occurs first; later on only its number (without the highest bit) is told.
    number_of_model = int(value.get("polymorphic_id", 0)) & 0x7FFFFFFF
    if "polymorphic_name" in value:
        names[number_of_model] = value["polymorphic_name"]
    model = names.get(number_of_model, "")
    data = _data(value, path)
    what = f"{path}: intrinsics"
    width, height = (whole(entry(data, key, what), f"{what}: {key}") for key in ("width", "height"))
    if model == "spherical":
        # Its pixels run from 0 to the width, not from the edge of the first pixel.
        return EquirectangularCamera(
            width, height, (width, width / 2), (-0.5, -0.5 + (width / 2 - height) / 2)
        )
    f = number(entry(data, "focal_length", what), f"{what}: focal_length")
    cx, cy = numbers(entry(data, "principal_point", what), f"{what}: principal_point", 2)
    K = np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]])
    if model == "pinhole":
        return PerspectiveCamera(width, height, K)
    keys = {"pinhole_radial_k1": ("disto_k1", 1), "pinhole_radial_k3": ("disto_k3", 3)}
    keys |= {"pinhole_brown_t2": ("disto_t2", 5), "fisheye": ("fisheye", 4)}
    if model not in keys:
        raise CameraError(f"{what}: the camera model '{model}' is not supported.")
    key, count = keys[model]
    lens = numbers(entry(data, key, what), f"{what}: {key}", count)
    if model == "fisheye":
        return FisheyeCamera(width, height, K, lens)
    return PerspectiveCamera(width, height, K, _brown(lens))


def _brown(lens: FloatArray) -> Distortion:
    """k1, k2, k3, t1, t2 or fewer; t1, t2 are OpenCV's p1, p2."""
    k1, k2, k3, t1, t2 = np.pad(lens, (0, 5 - lens.size)).tolist()
    return Distortion.from_opencv((k1, k2, t1, t2, k3))


def _read_alicevision(table: Mapping[str, Any], path: str) -> Reconstruction:
    version = tuple(int(v) for v in numbers(table.get("version", (1, 0, 0)), f"{path}: version"))
    cameras = {
        str(entry(item, "intrinsicId", path)): _alicevision_camera(item, version, path)
        for item in _items(table, "intrinsics", path)
    }
    poses = {
        str(entry(item, "poseId", path)): _alicevision_pose(item, path)
        for item in _items(table, "poses", path)
    }
    posed, unposed = [], []
    for view in _items(table, "views", path):
        name = Path(str(entry(view, "path", path)).replace("\\", "/")).name
        if "rigId" in view and str(view.get("isPoseIndependant", "true")) not in ("true", "1", "True"):
            raise CameraError(f"{path}: {name} belongs to a rig, which is not supported.")
        pose = poses.get(str(view.get("poseId")))
        if pose is None:
            unposed.append(name)
        elif str(view.get("intrinsicId")) not in cameras:
            raise CameraError(f"{path}: {name} has a pose but no camera.")
        else:
            posed.append(PosedCamera(name, cameras[str(view["intrinsicId"])], *pose))
    return Reconstruction(tuple(posed), *_alicevision_points(table, path), tuple(unposed))


def _alicevision_points(table: Mapping[str, Any], path: str) -> tuple[FloatArray, ByteArray]:
    marks = _items(table, "structure", path)
    points = np.array([numbers(entry(mark, "X", path), f"{path}: structure", 3) for mark in marks])
    grey = ("128",) * 3
    colours = np.array([numbers(mark.get("color", grey), f"{path}: structure", 3) for mark in marks])
    return points.reshape(-1, 3), np.clip(colours.reshape(-1, 3), 0, 255).astype(np.uint8)


def _alicevision_pose(item: Mapping[str, Any], path: str) -> tuple[FloatArray, FloatArray]:
    what = f"{path}: pose {item['poseId']}"
    transform = entry(entry(item, "pose", what), "transform", what)
    rotation = numbers(entry(transform, "rotation", what), what, 9).reshape(3, 3).T
    return pose_from_centre(
        checked_rotation(rotation, what), numbers(entry(transform, "center", what), what, 3)
    )


def _alicevision_camera(item: Mapping[str, Any], version: tuple[int, ...], path: str) -> Camera:
    what = f"{path}: intrinsic {item['intrinsicId']}"
    width, height = (whole(entry(item, key, what), f"{what}: {key}") for key in ("width", "height"))
    kind = str(entry(item, "type", what)).lower()
    lens_kind = str(item.get("distortionType") or "none").lower()
    if kind == "pinhole" and lens_kind != "none":
        kind = lens_kind
    cx, cy = numbers(entry(item, "principalPoint", what), f"{what}: principalPoint", 2)
    if version >= (1, 2, 1):
        cx, cy = cx + width / 2, cy + height / 2
    fx, fy = _alicevision_focal(item, version, width, what)
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    lens = numbers(item.get("distortionParams") or (), f"{what}: distortionParams")
    counts = {"pinhole": 0, "radial1": 1, "radialk1": 1, "radial3": 3, "radialk3": 3, "brown": 5}
    counts |= {"fisheye4": 4, "fisheye": 4, "fisheye1": 1}
    if kind not in counts:
        raise CameraError(f"{what}: the camera model '{kind}' is not supported.")
    if lens.size not in (0, counts[kind]):
        raise CameraError(f"{what}: '{kind}' has {counts[kind]} distortion parameters, found {lens.size}.")
    if kind == "fisheye1":
        return (
            FieldOfViewCamera(width, height, K, float(lens[0]))
            if lens.any()
            else PerspectiveCamera(width, height, K)
        )
    if kind in ("fisheye4", "fisheye"):
        return FisheyeCamera(width, height, K, lens)
    return PerspectiveCamera(width, height, K, _brown(lens))


def _alicevision_focal(
    item: Mapping[str, Any], version: tuple[int, ...], width: int, what: str
) -> tuple[float, float]:
    """Focal lengths in pixels, for every way in which versions tell them."""
    if version < (1, 2, 0):
        f = number(entry(item, "pxFocalLength", what), f"{what}: pxFocalLength")
        return f, f
    if version < (1, 2, 2):
        fx, fy = numbers(entry(item, "pxFocalLength", what), f"{what}: pxFocalLength", 2)
        return float(fx), float(fy)
    millimetres = number(entry(item, "focalLength", what), f"{what}: focalLength")
    sensor = number(item.get("sensorWidth", "36"), f"{what}: sensorWidth")
    ratio = number(item.get("pixelRatio", "1"), f"{what}: pixelRatio")
    fx = millimetres / sensor * width
    # Before version 1.2.5 the ratio was fx / fy, since then it is that of the pixel's sides.
    return fx, (fx / ratio if version < (1, 2, 5) else fx * ratio)
