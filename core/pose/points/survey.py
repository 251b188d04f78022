"""Tables of surveyed coordinates, and markers matched to them."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np

from ...arrays import FloatArray
from ...cameras.base import Camera
from ...errors import ScanError
from .markers import Marker
from .perturbation import camera_points

_COLUMNS = {
    "name": ("name", "id", "point", "punkt", "nr", "label", "number", "marker"),
    "x": ("x", "e", "easting", "east", "rechtswert", "y_east"),
    "y": ("y", "n", "northing", "north", "hochwert"),
    "z": ("z", "h", "height", "elevation", "alt", "altitude", "höhe", "hoehe"),
}


@dataclass(frozen=True, eq=False)
class Survey:
    """Named points with coordinates (N,3) m in the world frame."""

    names: tuple[str, ...]
    points: FloatArray


def read_survey(path: Path | str) -> Survey:
    """Read a table of names and coordinates: comma, semicolon, tab or blanks, with or without header.

    Columns are found by their titles (name, x/easting, y/northing, z/height), else taken as name, x, y, z.
    Lines that start with # are left out; with semicolons or tabs a comma may be the decimal sign. Raises
    `ScanError` with the line that cannot be read.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ScanError(f"{path}: cannot be read ({error.strerror}).") from error
    text = _decoded(data)
    numbered = [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1)]
    lines = [(number, line) for number, line in numbered if line and not line.startswith("#")]
    if not lines:
        raise ScanError(f"{path}: the table is empty.")
    delimiter = _delimiter(lines[0][1] if len(lines) == 1 else lines[1][1])
    rows = [(number, _cells(line, delimiter)) for number, line in lines]
    order = _header(rows[0][1])
    body = rows if order is None else rows[1:]
    names, points = [], []
    for number, cells in body:
        name, point = _row(path, number, cells, order or {"name": 0, "x": 1, "y": 2, "z": 3}, delimiter)
        if name in names:
            raise ScanError(
                f"{path}: line {number}: the point “{name}” is there twice; give each its own name."
            )
        names.append(name)
        points.append(point)
    if not points:
        raise ScanError(f"{path}: the table has a header but no points.")
    return Survey(tuple(names), np.array(points))


def _decoded(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _delimiter(line: str) -> str:
    for delimiter in (";", "\t"):
        if line.count(delimiter) >= 3:
            return delimiter
    return "," if line.count(",") >= 3 else " "


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader(StringIO(line), delimiter=delimiter))]


def _header(cells: Sequence[str]) -> dict[str, int] | None:
    """Columns by their titles, None when the first line is a point."""
    titles = [cell.lower().strip('"').split("[")[0].split("(")[0].strip() for cell in cells]
    order = {
        key: next((titles.index(name) for name in names if name in titles), -1)
        for key, names in _COLUMNS.items()
    }
    return order if all(order[axis] >= 0 for axis in "xyz") else None


def _row(
    path: Path, number: int, cells: Sequence[str], order: dict[str, int], delimiter: str
) -> tuple[str, list[float]]:
    if len(cells) <= max(order.values()):
        raise ScanError(
            f"{path}: line {number}: a name and three coordinates are needed, not “{' '.join(cells)}”."
        )
    point = []
    for axis in "xyz":
        text = cells[order[axis]]
        try:
            point.append(float(text.replace(",", ".") if delimiter != "," else text))
        except ValueError:
            raise ScanError(f"{path}: line {number}: “{text}” is no number for {axis}.") from None
    if not np.isfinite(point).all():
        raise ScanError(f"{path}: line {number}: the coordinates have to be finite.")
    name = cells[order["name"]] if order["name"] >= 0 else str(number)
    return name, point


def match_by_name(markers: Sequence[Marker], survey: Survey) -> tuple[FloatArray, FloatArray, list[str]]:
    """Pixels (M,2), points (M,3) m and names of the markers whose code is a name in the table.

    Codes found more than once in the photo are left out: one of them is wrong.
    """
    codes = [marker.name for marker in markers]
    single = {m.name: m.pixel for m in markers if m.name and codes.count(m.name) == 1}
    names = [name for name in survey.names if name in single]
    rows = [survey.names.index(name) for name in names]
    return np.array([single[n] for n in names]).reshape(-1, 2), survey.points[rows], names


def match_by_place(
    markers: Sequence[Marker],
    survey: Survey,
    camera: Camera,
    rotation: FloatArray,
    centre: FloatArray,
    radius: float,
) -> tuple[FloatArray, FloatArray, list[str]]:
    """The same for uncoded markers, by the pixel where a roughly known pose expects each point.

    A point and a marker are paired when each is the other's only one within `radius` pixels.
    """
    expected = camera.project(camera_points(rotation, centre, survey.points))
    found = np.array([marker.pixel for marker in markers]).reshape(-1, 2)
    near = np.linalg.norm(expected[:, None] - found[None], axis=2) < radius
    lone = near & (near.sum(axis=1, keepdims=True) == 1) & (near.sum(axis=0, keepdims=True) == 1)
    rows, columns = np.nonzero(lone)
    return found[columns], survey.points[rows], [survey.names[row] for row in rows]
