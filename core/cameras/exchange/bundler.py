"""Bundler's `bundle.out` and VisualSFM's NVM files.

Bundler: P = R X + t with y up and z backwards, p = -P / P.z, pixel = f (1 + k1 |p|^2 + k2 |p|^4) p from the
middle of the photo, y up. The file names no photos: they stand in a list of their own, in the same order.
NVM: quaternion w, x, y, z and centre with OpenCV's axes; a measured point m (over f) is undistorted as
m (1 + r |m|^2). Both put the origin in the middle of the photo.
Source: Bundler's user manual; VisualSFM's documentation of NVM and of its bundle adjustment.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...arrays import ByteArray, FloatArray
from ...errors import CameraError
from ..base import Camera
from ..files.text import exact, numbers, read_text, whole, write_text
from ..lens_models import InverseRadialCamera
from ..perspective import PerspectiveCamera
from .reconstruction import (
    PosedCamera,
    Reconstruction,
    SizeOf,
    checked_rotation,
    pose_from_centre,
    rotation_from_quaternion,
)

_Y_UP = np.diag([1.0, -1.0, -1.0])
_CENTRED = 1e-6
"""Pixels by which a principal point may miss the middle of the photo and still be written."""


def read_bundler(path: Path | str, names: Sequence[str], size_of: SizeOf) -> Reconstruction:
    """Cameras, poses and points of a Bundler file.

    Parameters
    ----------
    path
        `bundle.out`, version 0.3.
    names
        Photos in the file's order (`read_bundler_list`).
    size_of
        (width, height) of a photo by name.

    Raises
    ------
    CameraError
        A broken file, or one with another number of cameras than names.
    """
    text = "\n".join(line for line in read_text(path).splitlines() if not line.lstrip().startswith("#"))
    words = _Words(path, text)
    count, points = words.count(), words.count()
    if count != len(names):
        raise CameraError(f"{path} has {count} cameras, its list of photos {len(names)}.")
    posed, unposed = [], []
    for name in names:
        f, k1, k2 = words.take(3, f"{path}: {name}")
        rotation, translation = words.take(9, f"{path}: {name}"), words.take(3, f"{path}: {name}")
        if f == 0:
            unposed.append(name)
            continue
        camera = PerspectiveCamera(*size_of(name), _centred(f, size_of(name)), (k1, k2))
        turn = _Y_UP @ checked_rotation(rotation, f"{path}: {name}")
        posed.append(PosedCamera(name, camera, turn, _Y_UP @ translation))
    return Reconstruction(tuple(posed), *_points(words, points), tuple(unposed))


def read_bundler_list(path: Path | str) -> list[str]:
    """Names of the photos in Bundler's `list.txt`: the first word of every line."""
    return [line.split()[0] for line in read_text(path).splitlines() if line.strip()]


class _Words:
    """Words of a file, one after the other."""

    def __init__(self, path: Path | str, text: str):
        self.path = path
        self._words = text.split()
        self._position = 0

    def several(self, count: int) -> list[str]:
        words = self._words[self._position : self._position + count]
        if len(words) < count:
            raise CameraError(f"{self.path} is truncated.")
        self._position += count
        return words

    def take(self, count: int, what: str) -> FloatArray:
        return numbers(self.several(count), what, count)

    def count(self) -> int:
        value = whole(self.several(1)[0], f"{self.path}: count")
        if value < 0:
            raise CameraError(f"{self.path}: a count is negative.")
        return value


def _centred(focal: float, size: tuple[int, int]) -> FloatArray:
    """Camera matrix with the principal point in the middle of the photo."""
    return np.array([[focal, 0, size[0] / 2 - 0.5], [0, focal, size[1] / 2 - 0.5], [0, 0, 1]])


def _points(words: _Words, count: int) -> tuple[FloatArray, ByteArray]:
    """Points and colours; both formats list position, colour, number of views and four words for each."""
    rows = []
    for i in range(count):
        rows.append(words.take(6, f"{words.path}: point {i}"))
        words.several(4 * words.count())
    table = np.array(rows, dtype=np.float64).reshape(-1, 6)
    return table[:, :3].copy(), np.clip(table[:, 3:], 0, 255).astype(np.uint8)


def write_bundler(path: Path | str, list_path: Path | str, reconstruction: Reconstruction) -> None:
    """Write `bundle.out` and the list of its photos; points are written without views.

    Raises CameraError for cameras that Bundler cannot hold (anything but one focal length, a centred
    principal point and two radial terms), OutputError if a file cannot be written.
    """
    lines = ["# Bundle file v0.3", f"{len(reconstruction.cameras)} {len(reconstruction.points)}"]
    for posed in reconstruction.cameras:
        rotation, translation = _Y_UP @ posed.rotation, _Y_UP @ posed.translation
        rows = [_bundler_lens(posed.camera, posed.name), *rotation, translation]
        lines += [" ".join(exact(v) for v in row) for row in rows]
    colours = reconstruction.colours
    for i, point in enumerate(reconstruction.points):
        colour = colours[i].tolist() if i < len(colours) else (128, 128, 128)
        lines += [" ".join(exact(v) for v in point), " ".join(str(c) for c in colour), "0"]
    write_text(path, "\n".join(lines) + "\n")
    write_text(list_path, "".join(f"{posed.name}\n" for posed in reconstruction.cameras))


def _bundler_lens(camera: Camera, name: str) -> tuple[float, float, float]:
    if not isinstance(camera, PerspectiveCamera):
        raise CameraError(f"{name}: Bundler has no model for a {type(camera).__name__}.")
    lens, (fx, skew, cx), (_, fy, cy) = camera.distortion, camera.K[0], camera.K[1]
    if fx != fy or skew != 0:
        raise CameraError(f"{name}: Bundler has one focal length and no skew.")
    if max(abs(cx + 0.5 - camera.width / 2), abs(cy + 0.5 - camera.height / 2)) > _CENTRED:
        raise CameraError(
            f"{name}: Bundler needs the principal point in the middle: undistort the photos first."
        )
    if not lens.is_radial or lens.denominator or len(lens.radial) > 2:
        raise CameraError(f"{name}: Bundler has two radial terms of distortion only.")
    k1, k2 = (*lens.radial, 0.0, 0.0)[:2]
    return float(fx), k1, k2


def read_nvm(path: Path | str, size_of: SizeOf) -> Reconstruction:
    """Cameras, poses and points of the first model of a VisualSFM file (NVM_V3).

    `size_of` gives (width, height) of a photo by its name in the file, which may hold no blanks. Raises
    CameraError for broken files and for a fixed calibration with unequal focal lengths and distortion.
    """
    first, _, rest = read_text(path).partition("\n")
    if not first.startswith("NVM_V3") or first.startswith("NVM_V3_R9T"):
        raise CameraError(f"{path} is not an NVM_V3 file with quaternions.")
    fixed = numbers(first.split()[2:], f"{path}: FixedK") if "FixedK" in first else np.empty(0)
    words, posed = _Words(path, rest), []
    for _ in range(words.count()):
        row = words.several(11)
        name, what = row[0].strip('"'), f"{path}: {row[0]}"
        values = numbers(row[1:], what, 10)
        rotation = rotation_from_quaternion(values[1:5], what)
        camera = _nvm_camera(float(values[0]), float(values[8]), fixed, size_of(name), what)
        posed.append(PosedCamera(name, camera, *pose_from_centre(rotation, values[5:8])))
    return Reconstruction(tuple(posed), *_points(words, words.count()))


def _nvm_camera(focal: float, r: float, fixed: FloatArray, size: tuple[int, int], what: str) -> Camera:
    K = _centred(focal, size)
    if fixed.size >= 4:
        fx, cx, fy, cy = fixed[:4]
        # The principal point of a fixed calibration counts from the corner of the photo.
        K = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
    if r == 0:
        return PerspectiveCamera(*size, K)
    if K[0, 0] != K[1, 1]:
        raise CameraError(f"{what}: distortion together with unequal focal lengths is not supported.")
    return InverseRadialCamera(*size, K, r)
