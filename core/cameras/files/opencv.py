"""OpenCV calibration files (YAML, XML or JSON of cv::FileStorage), and ROS's camera_info YAML.

Perspective and fisheye calibrations share one layout; OpenCV's programs call the entries camera_matrix and
distortion_coefficients, others K and D. A fisheye is told by `fisheye_model` (OpenCV's sample) or by
`distortion_model` / `camera_model`; `xi` makes it Mei's model of `cv::omnidir`.
OpenCV's pixels count from the centre of the top-left one, like ours.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ...arrays import FloatArray
from ...errors import CameraError
from ..base import Camera
from ..catadioptric import CatadioptricCamera
from ..fisheye import FisheyeCamera
from ..perspective import PerspectiveCamera
from ..plane import PlaneCamera
from .text import read_text, write_text

_MATRIX = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "M1")
_COEFFICIENTS = (
    "distortion_coefficients",
    "Distortion_Coefficients",
    "distCoeffs",
    "dist_coeffs",
    "dist_coeff",
    "D",
    "D1",
)
_WIDTH = ("image_width", "image_Width", "width")
_HEIGHT = ("image_height", "image_Height", "height")
_MODEL = ("distortion_model", "camera_model", "model")
_FISHEYE_WORDS = ("fisheye", "equidistant", "kannala_brandt")
_FISHEYE_FLAG = 1 << 0


def read_opencv(path: Path | str, size: tuple[int, int] | None = None) -> Camera:
    """Camera from an OpenCV calibration file.

    Parameters
    ----------
    path
        A .yml, .yaml, .xml or .json file of cv::FileStorage.
    size
        (width, height) of the photo when the file does not tell it.

    Raises
    ------
    CameraError
        No such file, missing or wrong entries, a model that is not known.
    """
    storage = _open(path)
    try:
        width, height = _size(storage, path, size)
        K = _matrix(storage, _MATRIX, path, "the camera matrix")
        if K.shape != (3, 3):
            raise CameraError(f"{path}: the camera matrix must be 3 x 3.")
        lens = _matrix(storage, _COEFFICIENTS, path, "the distortion coefficients").ravel()
        xi = storage.getNode("xi")
        if not xi.empty():
            return CatadioptricCamera(width, height, K, float(_values(xi, path, "xi").ravel()[0]), lens)
        if _is_fisheye(storage):
            return FisheyeCamera(width, height, K, lens)
        return PerspectiveCamera(width, height, K, lens)
    finally:
        storage.release()


def _open(path: Path | str) -> cv2.FileStorage:
    text = read_text(path).lstrip()
    if not text.startswith(("%", "<", "{")):
        text = f"%YAML:1.0\n---\n{text}"  # ROS writes the same layout without OpenCV's first line
    storage = cv2.FileStorage()
    try:
        opened = storage.open(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except (cv2.error, SystemError) as error:
        raise CameraError(f"{path} is not a complete OpenCV calibration file.") from error
    if not opened or not storage.root().isMap():
        raise CameraError(f"{path} is not an OpenCV calibration file.")
    return storage


def _size(storage: cv2.FileStorage, path: Path | str, size: tuple[int, int] | None) -> tuple[int, int]:
    nodes = [_first(storage, names) for names in (_WIDTH, _HEIGHT)]
    given = [int(node.real()) for node in nodes if node is not None and (node.isInt() or node.isReal())]
    if len(given) == 2:
        if size is not None and tuple(given) != tuple(size):
            raise CameraError(
                f"{path} is for photos of {given[0]} x {given[1]} pixels, this one has {size[0]} x {size[1]}."
            )
        return given[0], given[1]
    if size is None:
        raise CameraError(f"{path} has no image_width and image_height: give the size of the photo.")
    return size


def _first(storage: cv2.FileStorage, names: tuple[str, ...]) -> cv2.FileNode | None:
    nodes = (storage.getNode(name) for name in names)
    return next((node for node in nodes if not node.empty()), None)


def _matrix(storage: cv2.FileStorage, names: tuple[str, ...], path: Path | str, what: str) -> FloatArray:
    node = _first(storage, names)
    if node is None:
        raise CameraError(f"{path}: {what} ({names[0]}) is missing.")
    return _values(node, path, what)


def _values(node: cv2.FileNode, path: Path | str, what: str) -> FloatArray:
    """Numbers of a matrix, a plain list or a single number."""
    problem = CameraError(f"{path}: {what} must be finite numbers.")
    try:
        if node.isMap():
            # Not node.mat(): OpenCV 4.11 misreads matrices in which some numbers have no decimal point.
            shape = [int(_number(node.getNode(key), problem)) for key in ("rows", "cols")]
            values = _sequence(node.getNode("data"), problem).reshape(shape)
        else:
            values = _sequence(node, problem)
    except (cv2.error, SystemError, ValueError) as error:
        raise problem from error
    if values.size == 0 or not np.all(np.isfinite(values)):
        raise problem
    return values


def _sequence(node: cv2.FileNode, problem: CameraError) -> FloatArray:
    """Numbers of a list, or a single number."""
    nodes = [node.at(i) for i in range(node.size())] if node.isSeq() else [node]
    return np.array([_number(each, problem) for each in nodes])


def _number(node: cv2.FileNode, problem: CameraError) -> float:
    if not (node.isInt() or node.isReal()):
        raise problem
    return float(node.real())


def _is_fisheye(storage: cv2.FileStorage) -> bool:
    flag = storage.getNode("fisheye_model")
    if not flag.empty():
        return int(flag.real()) & _FISHEYE_FLAG != 0
    model = _first(storage, _MODEL)
    return model is not None and model.isString() and model.string().lower() in _FISHEYE_WORDS


def write_opencv(path: Path | str, camera: Camera) -> None:
    """Write a perspective, fisheye or unified-sphere camera as OpenCV YAML (.yml, .yaml), XML or JSON.

    Raises CameraError for a camera that OpenCV has no model for, OutputError if the file cannot be written.
    """
    if not isinstance(camera, PlaneCamera):
        raise CameraError(f"OpenCV has no model for a {type(camera).__name__}.")
    lens, fisheye, xi = _opencv_model(camera)
    suffix = Path(path).suffix.lower()
    if suffix not in (".yml", ".yaml", ".xml", ".json"):
        raise CameraError(f"{path}: an OpenCV calibration file ends in .yml, .yaml, .xml or .json.")
    storage = cv2.FileStorage(f"camera{suffix}", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("image_width", camera.width)
    storage.write("image_height", camera.height)
    storage.write("fisheye_model", int(fisheye))
    storage.write("camera_matrix", camera.K)
    storage.write("distortion_coefficients", np.array(lens, dtype=np.float64).reshape(-1, 1))
    if xi is not None:
        storage.write("xi", xi)
    write_text(path, storage.releaseAndGetString())


def _opencv_model(camera: PlaneCamera) -> tuple[tuple[float, ...], bool, float | None]:
    """Coefficients, whether they are the fisheye model's, and xi of the unified sphere."""
    if isinstance(camera, PerspectiveCamera):
        return camera.distortion.opencv or (0.0,) * 4, False, None
    if isinstance(camera, CatadioptricCamera):
        return camera.distortion.opencv or (0.0,) * 4, False, camera.xi
    if isinstance(camera, FisheyeCamera):
        lens = camera.coefficients
        if camera.distortion.is_zero and not any(lens[4:]):
            return (*lens, *(0.0,) * 4)[:4], True, None
        raise CameraError("OpenCV's fisheye model has k1..k4 only; this lens has more terms.")
    raise CameraError(f"OpenCV has no model for a {type(camera).__name__}.")
