"""COLMAP's camera models: lines of cameras.txt and the parameters of cameras.bin.

COLMAP puts the corner of the top-left pixel at (0, 0), so its centre is (0.5, 0.5): half a pixel is taken off
the principal point here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray
from ...errors import CameraError
from ..base import Camera
from ..distortion import NO_DISTORTION, Distortion
from ..equirectangular import EquirectangularCamera
from ..fisheye import FisheyeCamera
from ..lens_models import DivisionCamera, ExtendedUnifiedCamera, FieldOfViewCamera
from ..perspective import PerspectiveCamera
from ..plane import PlaneCamera
from .text import exact, numbers, whole

_Lens = tuple[float, ...]
_Make = Callable[[int, int, FloatArray, _Lens], Camera]


@dataclass(frozen=True)
class ColmapModel:
    """Number in binary files, count of focal lengths (1: f, 2: fx, fy) and of lens parameters."""

    number: int
    focals: int
    lens: int
    make: _Make

    @property
    def count(self) -> int:
        """Number of parameters."""
        return self.focals + 2 + self.lens


def _fisheye(width: int, height: int, K: FloatArray, lens: _Lens) -> Camera:
    return FisheyeCamera(width, height, K, lens)


def _thin_prism(width: int, height: int, K: FloatArray, lens: _Lens) -> Camera:
    k1, k2, p1, p2, k3, k4, sx1, sy1 = lens
    plane = Distortion(radial=(k1, k2, k3, k4), tangential=(p1, p2), prism=(sx1, 0.0, sy1, 0.0))
    return FisheyeCamera(width, height, K, (), plane)


def _rad_tan_thin_prism(width: int, height: int, K: FloatArray, lens: _Lens) -> Camera:
    # p0 belongs to r^2 + 2 x^2, which is OpenCV's p2.
    plane = Distortion(tangential=(lens[7], lens[6]), prism=(lens[8], lens[9], lens[10], lens[11]))
    return FisheyeCamera(width, height, K, lens[:6], plane)


def _division(width: int, height: int, K: FloatArray, lens: _Lens) -> Camera:
    return DivisionCamera(width, height, K, *lens)


MODELS = {
    "SIMPLE_PINHOLE": ColmapModel(0, 1, 0, PerspectiveCamera),
    "PINHOLE": ColmapModel(1, 2, 0, PerspectiveCamera),
    "SIMPLE_RADIAL": ColmapModel(2, 1, 1, PerspectiveCamera),
    "RADIAL": ColmapModel(3, 1, 2, PerspectiveCamera),
    "OPENCV": ColmapModel(4, 2, 4, PerspectiveCamera),
    "OPENCV_FISHEYE": ColmapModel(5, 2, 4, _fisheye),
    "FULL_OPENCV": ColmapModel(6, 2, 8, PerspectiveCamera),
    "FOV": ColmapModel(7, 2, 1, lambda w, h, K, lens: FieldOfViewCamera(w, h, K, *lens)),
    "SIMPLE_RADIAL_FISHEYE": ColmapModel(8, 1, 1, _fisheye),
    "RADIAL_FISHEYE": ColmapModel(9, 1, 2, _fisheye),
    "THIN_PRISM_FISHEYE": ColmapModel(10, 2, 8, _thin_prism),
    "RAD_TAN_THIN_PRISM_FISHEYE": ColmapModel(11, 2, 12, _rad_tan_thin_prism),
    "SIMPLE_DIVISION": ColmapModel(12, 1, 1, _division),
    "DIVISION": ColmapModel(13, 2, 1, _division),
    "SIMPLE_FISHEYE": ColmapModel(14, 1, 0, _fisheye),
    "FISHEYE": ColmapModel(15, 2, 0, _fisheye),
    "EUCM": ColmapModel(16, 2, 2, lambda w, h, K, lens: ExtendedUnifiedCamera(w, h, K, *lens)),
}
"""COLMAP's perspective models by name; EQUIRECTANGULAR (17; parameters width, height) has no matrix."""

EQUIRECTANGULAR = ("EQUIRECTANGULAR", 17, 2)


def camera_from_colmap(
    model: str, width: int, height: int, parameters: Sequence[float], what: str = "camera"
) -> Camera:
    """Camera from COLMAP's model name and parameters; CameraError if they do not fit."""
    name, _, count = EQUIRECTANGULAR
    if model == name:
        full = numbers(parameters, f"{what}: parameters of {model}", count)
        return EquirectangularCamera(width, height, (float(full[0]), float(full[1])))
    if model not in MODELS:
        raise CameraError(f"{what}: '{model}' is not a COLMAP camera model that is known here.")
    known = MODELS[model]
    values = numbers(parameters, f"{what}: parameters of {model}", known.count)
    fx, fy = values[0], values[known.focals - 1]
    cx, cy = values[known.focals : known.focals + 2] - 0.5
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    try:  # all perspective models list their lens in the order of OpenCV
        return known.make(width, height, K, tuple(values[known.focals + 2 :].tolist()))
    except CameraError as error:
        raise CameraError(f"{what}: {error}") from error


def colmap_from_camera(camera: Camera) -> tuple[str, list[float]]:
    """Name and parameters of COLMAP's simplest model that holds a camera exactly, or CameraError."""
    if isinstance(camera, EquirectangularCamera):
        if not camera.is_whole:
            raise CameraError("COLMAP has no model for a cropped panorama.")
        return EQUIRECTANGULAR[0], [float(camera.width), float(camera.height)]
    if not isinstance(camera, PlaneCamera):
        raise CameraError(f"COLMAP has no model for a {type(camera).__name__}.")
    if camera.K[0, 1] != 0:
        raise CameraError("COLMAP has no model for a camera matrix with skew.")
    model, lens = _colmap_lens(camera)
    focals = [camera.K[0, 0], camera.K[1, 1]][: MODELS[model].focals]
    return model, [float(v) for v in (*focals, camera.K[0, 2] + 0.5, camera.K[1, 2] + 0.5, *lens)]


def _colmap_lens(camera: PlaneCamera) -> tuple[str, _Lens]:
    square = camera.K[0, 0] == camera.K[1, 1]
    if isinstance(camera, PerspectiveCamera):
        return _perspective_lens(camera.distortion, square)
    if isinstance(camera, FisheyeCamera):
        return _fisheye_lens(camera, square)
    if isinstance(camera, DivisionCamera):
        return ("SIMPLE_DIVISION" if square else "DIVISION"), (camera.k,)
    if isinstance(camera, ExtendedUnifiedCamera):
        return "EUCM", (camera.alpha, camera.beta)
    if isinstance(camera, FieldOfViewCamera):
        return "FOV", (camera.omega,)
    raise CameraError(f"COLMAP has no model for a {type(camera).__name__}.")


def _perspective_lens(distortion: Distortion, square: bool) -> tuple[str, _Lens]:
    lens = (*distortion.opencv, *(0.0,) * 12)[:12]
    if any(lens[8:]):
        raise CameraError("COLMAP has no perspective model with thin-prism terms.")
    if any(lens[4:]):
        return "FULL_OPENCV", lens[:8]
    if any(lens[2:4]) or (any(lens) and not square):
        return "OPENCV", lens[:4]
    if lens[1] != 0:
        return "RADIAL", lens[:2]
    if lens[0] != 0:
        return "SIMPLE_RADIAL", lens[:1]
    return ("SIMPLE_PINHOLE" if square else "PINHOLE"), ()


def _fisheye_lens(camera: FisheyeCamera, square: bool) -> tuple[str, _Lens]:
    lens, plane = (*camera.coefficients, *(0.0,) * 6)[:6], camera.distortion
    if plane == NO_DISTORTION or plane.is_zero:
        if not any(lens):
            return ("SIMPLE_FISHEYE" if square else "FISHEYE"), ()
        if square and not any(lens[2:]):
            return ("RADIAL_FISHEYE", lens[:2]) if lens[1] else ("SIMPLE_RADIAL_FISHEYE", lens[:1])
        if not any(lens[4:]):
            return "OPENCV_FISHEYE", lens[:4]
    s1, s2, s3, s4 = plane.prism
    if not plane.radial and not plane.denominator:
        p1, p2 = plane.tangential
        return "RAD_TAN_THIN_PRISM_FISHEYE", (*lens, p2, p1, s1, s2, s3, s4)
    if any(lens) or plane.denominator or len(plane.radial) > 4 or s2 != 0 or s4 != 0:
        raise CameraError("COLMAP has no fisheye model with all terms of this lens.")
    k1, k2, k3, k4 = (*plane.radial, *(0.0,) * 4)[:4]
    return "THIN_PRISM_FISHEYE", (k1, k2, *plane.tangential, k3, k4, s1, s3)


def camera_from_colmap_line(line: str, what: str = "camera line") -> tuple[int, Camera]:
    """Id and camera from a line `CAMERA_ID MODEL WIDTH HEIGHT PARAMS...` of cameras.txt."""
    words = line.split()
    if len(words) < 4:
        raise CameraError(f"{what}: expected CAMERA_ID, MODEL, WIDTH, HEIGHT and parameters.")
    identity, width, height = (whole(words[i], f"{what}: {words[i]}") for i in (0, 2, 3))
    return identity, camera_from_colmap(words[1], width, height, [_float(w, what) for w in words[4:]], what)


def _float(word: str, what: str) -> float:
    return float(numbers([word], f"{what}: {word}", 1)[0])


def colmap_line(identity: int, camera: Camera) -> str:
    """Line of cameras.txt for a camera; CameraError if COLMAP has no model for it."""
    model, parameters = colmap_from_camera(camera)
    words = [str(identity), model, str(camera.width), str(camera.height), *(exact(v) for v in parameters)]
    return " ".join(words)
