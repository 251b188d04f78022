"""OCamCalib's `calib_results.txt` (Scaramuzza's toolbox).

Its camera frame has x along the rows (down), y along the columns (right) and therefore z backwards: rays are
`(x, y, f(rho))` with f(0) < 0. A pixel is `(row, column) = [[c, d], [e, 1]] (x, y) + centre`, from the
centre of the top-left one (0, 0). Swapping the axes and turning z gives ours:

    (u, v) = centre + [[1, e], [d, c]] (x, y),   g = -f

and, as our matrix ends in 1, lengths on the plane are multiplied by c.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...arrays import FloatArray
from ...errors import CameraError
from ..polynomial import PolynomialCamera
from .text import exact, numbers, read_text, write_text

_INVERSE_TOLERANCE = 0.01
"""Largest error (pixels) of the inverse polynomial that is written for programs which use it."""

_MOST_INVERSE_TERMS = 26


def read_ocamcalib(path: Path | str) -> PolynomialCamera:
    """Camera from OCamCalib's text file; CameraError if parts are missing or are not numbers."""
    lines = [line.strip() for line in read_text(path).splitlines()]
    rows = [line for line in lines if line and not line.startswith("#")]
    if len(rows) < 5:
        raise CameraError(f"{path}: expected five blocks of numbers (OCamCalib), found {len(rows)}.")
    direct = _counted(rows[0], f"{path}: direct polynomial")
    _counted(rows[1], f"{path}: inverse polynomial")
    row, column = numbers(rows[2], f"{path}: centre", 2)
    c, d, e = numbers(rows[3], f"{path}: affine parameters", 3)
    height, width = numbers(rows[4], f"{path}: image size", 2)
    if c <= 0:
        raise CameraError(f"{path}: the affine parameter c must be positive.")
    if direct[0] >= 0:
        raise CameraError(f"{path}: the first coefficient of the direct polynomial must be negative.")
    coefficients = -direct * c ** (1.0 - np.arange(direct.size))
    return PolynomialCamera(int(width), int(height), (column, row), coefficients, (1 / c, e / c, d / c))


def _counted(line: str, what: str) -> FloatArray:
    """Numbers of a line that starts with how many there are."""
    values = numbers(line, what)
    if values.size < 2 or values[0] != values.size - 1:
        raise CameraError(f"{what}: its first number must count the others.")
    return values[1:]


def write_ocamcalib(path: Path | str, camera: PolynomialCamera) -> None:
    """Write a polynomial camera as OCamCalib's text file, with the inverse polynomial its C code needs.

    Raises CameraError for a camera that the format cannot hold, OutputError if the file cannot be written.
    """
    if not isinstance(camera, PolynomialCamera):
        raise CameraError(f"An OCamCalib file holds a polynomial camera, not a {type(camera).__name__}.")
    c = 1 / camera.stretch[0]
    e, d = camera.stretch[1] * c, camera.stretch[2] * c
    powers = 1.0 - np.arange(len(camera.coefficients))
    direct = -np.array(camera.coefficients) / c**powers
    blocks = [
        ("polynomial coefficients of the direct mapping (cam2world)", [direct.size, *direct]),
        ("polynomial coefficients of the inverse mapping (world2cam)", _inverse(camera, c)),
        ('center: "row" and "column", starting from 0 (C convention)', [camera.centre[1], camera.centre[0]]),
        ('affine parameters "c", "d", "e"', [c, d, e]),
        ('image size: "height" and "width"', [camera.height, camera.width]),
    ]
    text = "".join(f"#{title}\n\n{' '.join(_word(v) for v in values)}\n\n" for title, values in blocks)
    write_text(path, text)


def _word(value: float) -> str:
    return str(int(value)) if isinstance(value, (int, np.integer)) else exact(value)


def _inverse(camera: PolynomialCamera, c: float) -> list[float]:
    """Count and coefficients of rho as a polynomial of the elevation angle in OCamCalib's frame."""
    corners = np.array([(u, v) for u in (-0.5, camera.width - 0.5) for v in (-0.5, camera.height - 0.5)])
    reach = min(float(np.hypot(*(corners - camera.centre).T).max() * max(c, 1)), camera.limit * 0.999)
    rho = np.linspace(0, reach, 1000)
    elevation = np.arctan2(-camera.lift(rho)[0], rho)  # straight ahead is -90 degrees there
    for terms in range(5, _MOST_INVERSE_TERMS + 1):
        powers = elevation[:, None] ** np.arange(terms)
        coefficients = np.linalg.lstsq(powers, rho / c, rcond=None)[0]
        if np.abs(powers @ coefficients - rho / c).max() <= _INVERSE_TOLERANCE:
            break
    return [int(coefficients.size), *coefficients.tolist()]
