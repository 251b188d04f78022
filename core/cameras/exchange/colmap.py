"""COLMAP's sparse models: folders of cameras, images and points3D, as text (.txt) or binary (.bin).

A pose is a quaternion w, x, y, z and a translation, world to camera with OpenCV's axes, like ours. Newer
models also hold rigs and frames; their images still carry the composed poses, so those are read.
Source: COLMAP documentation, output format.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ...arrays import ByteArray, FloatArray
from ...errors import CameraError
from ..base import Camera
from ..files.colmap import (
    EQUIRECTANGULAR,
    MODELS,
    camera_from_colmap,
    camera_from_colmap_line,
    colmap_from_camera,
    colmap_line,
)
from ..files.text import exact, numbers, read_bytes, read_text, whole, write_bytes, write_text
from .reconstruction import (
    PosedCamera,
    Reconstruction,
    distinct_cameras,
    quaternion_from_rotation,
    rotation_from_quaternion,
)

_MODEL_NAMES = {model.number: (name, model.count) for name, model in MODELS.items()}
_MODEL_NAMES[EQUIRECTANGULAR[1]] = (EQUIRECTANGULAR[0], EQUIRECTANGULAR[2])
_POINT = struct.Struct("<Q3d3BdQ")
_MODEL_NUMBERS = {name: number for number, (name, _) in _MODEL_NAMES.items()}


def read_colmap(folder: Path | str) -> Reconstruction:
    """Cameras, poses and points of a COLMAP model; binary files win where both kinds exist.

    Raises
    ------
    CameraError
        Missing, truncated or senseless files, or a camera model that is not known.
    """
    folder = Path(folder)
    if all((folder / f"{part}.bin").exists() for part in ("cameras", "images")):
        cameras = _read_cameras_binary(folder / "cameras.bin")
        images = _read_images_binary(folder / "images.bin", cameras)
        points = _read_points_binary(folder / "points3D.bin")
    elif all((folder / f"{part}.txt").exists() for part in ("cameras", "images")):
        cameras = _read_cameras_text(folder / "cameras.txt")
        images = _read_images_text(folder / "images.txt", cameras)
        points = _read_points_text(folder / "points3D.txt")
    else:
        raise CameraError(f"{folder} has no COLMAP model: cameras and images as .bin or .txt are needed.")
    return Reconstruction(tuple(images), *points)


def _content_lines(path: Path) -> Iterator[tuple[str, str]]:
    """Lines without comments, blank ones kept, each with its place for error texts."""
    for count, line in enumerate(read_text(path).splitlines(), start=1):
        if not line.startswith("#"):
            yield f"{path}, line {count}", line


def _read_cameras_text(path: Path) -> dict[int, Camera]:
    return dict(camera_from_colmap_line(line, what) for what, line in _content_lines(path) if line.strip())


def _read_images_text(path: Path, cameras: dict[int, Camera]) -> list[PosedCamera]:
    lines = list(_content_lines(path))
    while lines and not lines[0][1].strip():
        lines.pop(0)
    images = []
    for what, line in lines[::2]:  # every second line, blank or not, lists the observations
        words = line.split(maxsplit=9)
        if not words:
            continue
        if len(words) < 10:
            raise CameraError(
                f"{what}: expected IMAGE_ID, a quaternion, a translation, CAMERA_ID and a name."
            )
        pose = numbers(words[1:8], what, 7)
        images.append(_image(words[9].strip(), pose, whole(words[8], what), cameras, what))
    return images


def _image(name: str, pose: FloatArray, camera: int, cameras: dict[int, Camera], what: str) -> PosedCamera:
    if camera not in cameras:
        raise CameraError(f"{what}: the camera {camera} of {name} is not in the list of cameras.")
    return PosedCamera(name, cameras[camera], rotation_from_quaternion(pose[:4], what), pose[4:7].copy())


def _read_points_text(path: Path) -> tuple[FloatArray, ByteArray]:
    if not path.exists():
        return _points([])
    lines = [(what, line) for what, line in _content_lines(path) if line.strip()]
    try:  # all at once, as there may be a million
        text = [line for _, line in lines]
        return _points(np.loadtxt(text, usecols=range(1, 7), comments=None, ndmin=2) if text else [])
    except ValueError:  # now with the place of the error
        return _points([numbers(line.split()[1:7], what, 6) for what, line in lines])


def _points(rows: Sequence[Sequence[float] | FloatArray] | FloatArray) -> tuple[FloatArray, ByteArray]:
    table = np.array(rows, dtype=np.float64).reshape(-1, 6)
    return table[:, :3].copy(), np.clip(table[:, 3:], 0, 255).astype(np.uint8)


class _Reader:
    """Little-endian numbers from a file, one after the other."""

    def __init__(self, path: Path):
        self.path = path
        self._data = read_bytes(path)
        self._position = 0

    def take(self, layout: str) -> tuple[float, ...]:
        size = struct.calcsize(f"<{layout}")
        self._require(size)
        values = struct.unpack_from(f"<{layout}", self._data, self._position)
        self._position += size
        return values

    def skip(self, size: int) -> None:
        self._require(size)
        self._position += size

    def take_point(self) -> tuple[float, ...]:
        """Position and colour of a point; its number, error and track are passed over."""
        self._require(_POINT.size)
        values = _POINT.unpack_from(self._data, self._position)
        self._position += _POINT.size
        self.skip(8 * values[8])
        return values[1:7]

    def name(self) -> str:
        end = self._data.find(b"\0", self._position)
        if end < 0:
            raise CameraError(f"{self.path} is truncated.")
        text = self._data[self._position : end].decode("utf-8", "replace")
        self._position = end + 1
        return text

    def _require(self, size: int) -> None:
        if self._position + size > len(self._data):
            raise CameraError(f"{self.path} is truncated.")


def _read_cameras_binary(path: Path) -> dict[int, Camera]:
    reader = _Reader(path)
    cameras = {}
    for _ in range(int(reader.take("Q")[0])):
        identity, model, width, height = (int(v) for v in reader.take("IiQQ"))
        if model not in _MODEL_NAMES:
            raise CameraError(f"{path}: the camera model number {model} is not known here.")
        name, count = _MODEL_NAMES[model]
        what = f"{path}, camera {identity}"
        cameras[identity] = camera_from_colmap(name, width, height, reader.take(f"{count}d"), what)
    return cameras


def _read_images_binary(path: Path, cameras: dict[int, Camera]) -> list[PosedCamera]:
    reader = _Reader(path)
    images = []
    for _ in range(int(reader.take("Q")[0])):
        values = reader.take("I7dI")
        name, what = reader.name(), f"{path}, image {int(values[0])}"
        pose = numbers(values[1:8], what, 7)
        images.append(_image(name, pose, int(values[8]), cameras, what))
        reader.skip(24 * int(reader.take("Q")[0]))
    return images


def _read_points_binary(path: Path) -> tuple[FloatArray, ByteArray]:
    if not path.exists():
        return _points([])
    reader = _Reader(path)
    return _points([reader.take_point() for _ in range(int(reader.take("Q")[0]))])


def write_colmap(folder: Path | str, reconstruction: Reconstruction, binary: bool = False) -> None:
    """Write cameras, images and points3D of a COLMAP model into a folder, as text or binary.

    Photos with the same camera share it; points are written without observations. Raises CameraError for
    cameras that COLMAP has no model for, OutputError if the folder cannot be written.
    """
    cameras, indices = distinct_cameras(reconstruction.cameras)
    models = [colmap_from_camera(camera) for camera in cameras]
    folder = Path(folder)
    if binary:
        _write_binary(folder, reconstruction, cameras, models, indices)
    else:
        _write_text(folder, reconstruction, cameras, indices)


def _colours(reconstruction: Reconstruction) -> ByteArray:
    """One colour for every point, grey where there are none."""
    if len(reconstruction.colours) == len(reconstruction.points):
        return reconstruction.colours
    return np.full((len(reconstruction.points), 3), 128, dtype=np.uint8)


def _write_text(
    folder: Path, reconstruction: Reconstruction, cameras: list[Camera], indices: list[int]
) -> None:
    lines = ["# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]"]
    lines += [colmap_line(i, camera) for i, camera in enumerate(cameras, start=1)]
    write_text(folder / "cameras.txt", "\n".join(lines) + "\n")
    lines = ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of POINTS2D[]"]
    for i, (posed, index) in enumerate(zip(reconstruction.cameras, indices, strict=True), start=1):
        pose = " ".join(exact(v) for v in (*quaternion_from_rotation(posed.rotation), *posed.translation))
        lines += [f"{i} {pose} {index + 1} {posed.name}", ""]
    write_text(folder / "images.txt", "\n".join(lines) + "\n")
    lines = ["# POINT3D_ID X Y Z R G B ERROR TRACK[]"]
    rows = zip(reconstruction.points, _colours(reconstruction), strict=True)
    for i, (point, colour) in enumerate(rows, start=1):
        lines.append(f"{i} {' '.join(exact(v) for v in point)} {' '.join(str(int(c)) for c in colour)} 0")
    write_text(folder / "points3D.txt", "\n".join(lines) + "\n")


def _write_binary(
    folder: Path,
    reconstruction: Reconstruction,
    cameras: list[Camera],
    models: list[tuple[str, list[float]]],
    indices: list[int],
) -> None:
    parts = [struct.pack("<Q", len(cameras))]
    for i, (camera, (name, parameters)) in enumerate(zip(cameras, models, strict=True), start=1):
        parts.append(struct.pack("<IiQQ", i, _MODEL_NUMBERS[name], camera.width, camera.height))
        parts.append(struct.pack(f"<{len(parameters)}d", *parameters))
    write_bytes(folder / "cameras.bin", b"".join(parts))
    parts = [struct.pack("<Q", len(reconstruction.cameras))]
    for i, (posed, index) in enumerate(zip(reconstruction.cameras, indices, strict=True), start=1):
        pose = (*quaternion_from_rotation(posed.rotation), *posed.translation)
        parts.append(struct.pack("<I7dI", i, *pose, index + 1))
        parts.append(posed.name.encode() + b"\0" + struct.pack("<Q", 0))
    write_bytes(folder / "images.bin", b"".join(parts))
    parts = [struct.pack("<Q", len(reconstruction.points))]
    rows = zip(reconstruction.points, _colours(reconstruction), strict=True)
    for i, (point, colour) in enumerate(rows, start=1):
        parts.append(struct.pack("<Q3d3BdQ", i, *point, *colour.tolist(), 0.0, 0))
    write_bytes(folder / "points3D.bin", b"".join(parts))
