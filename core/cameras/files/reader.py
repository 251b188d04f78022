"""One reader for every camera file: the content tells whose it is."""

from __future__ import annotations

import json
from pathlib import Path

from ...errors import CameraError
from ..base import Camera
from .colmap import camera_from_colmap_line
from .dictionary import camera_from_dict
from .metashape import read_metashape
from .ocamcalib import read_ocamcalib
from .opencv import read_opencv
from .text import read_text


def read_camera(path: Path | str, size: tuple[int, int] | None = None) -> Camera:
    """Camera from a file of ours, OpenCV, OCamCalib, COLMAP (cameras.txt with one camera) or Metashape.

    Parameters
    ----------
    path
        The file; its content decides how it is read.
    size
        (width, height) of the photo. A calibration made at another size of the same shape is scaled to it.

    Raises
    ------
    CameraError
        A file that is none of these or is broken, or one for photos of another shape.
    """
    camera = _read(Path(path), size)
    if size is None or (camera.width, camera.height) == tuple(size):
        return camera
    # Half a pixel of rounding is allowed in the smaller side.
    if abs(camera.height * size[0] / camera.width - size[1]) > 1:
        raise CameraError(
            f"{path} is for photos of {camera.width} x {camera.height} pixels, "
            f"which have another shape than {size[0]} x {size[1]}."
        )
    return camera.resized(*size)


def _read(path: Path, size: tuple[int, int] | None) -> Camera:
    text = read_text(path)
    start = text.lstrip()[:2000]
    if start.startswith("<"):
        return read_opencv(path) if "<opencv_storage" in start else read_metashape(path)
    if start.startswith("{"):
        return _read_json(path, text, size)
    if start.startswith("%YAML") or path.suffix.lower() in (".yml", ".yaml"):
        return read_opencv(path, _missing_size(text, size))
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if lines and len(lines[0].split()) > 3 and lines[0].split()[1].replace("_", "").isalpha():
        if len(lines) > 1:
            raise CameraError(f"{path} holds {len(lines)} cameras: import it as a COLMAP reconstruction.")
        return camera_from_colmap_line(lines[0], str(path))[1]
    return read_ocamcalib(path)


def _read_json(path: Path, text: str, size: tuple[int, int] | None) -> Camera:
    try:
        table = json.loads(text)
    except json.JSONDecodeError as error:
        raise CameraError(f"{path} is not a complete JSON file ({error}).") from error
    if "model" in table and "width" in table:
        return camera_from_dict(table, str(path))
    return read_opencv(path, _missing_size(text, size))


def _missing_size(text: str, size: tuple[int, int] | None) -> tuple[int, int] | None:
    """The photo's size only for files that do not tell theirs."""
    return None if "width" in text.lower() else size
