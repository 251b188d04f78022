"""The [cameras] table of a project file: cameras that another program has solved."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from ...arrays import FloatArray
from ...cameras.exchange.reconstruction import checked_rotation
from ...errors import CameraError
from ..imported import ImportedCameras, Placing, match_photos, read_cameras
from .table import Table


def read_imported(table: Table, photos: Sequence[Path]) -> ImportedCameras | None:
    """Read the table and the files it names; None without it. Raises ProjectError."""
    if not table.values:
        return None
    path = table.existing_any("import")
    try:
        reconstruction = read_cameras(path, photos)
    except CameraError as error:
        table.fail("import", str(error))
    if not match_photos(reconstruction, photos):
        names = ", ".join(camera.name for camera in reconstruction.cameras[:3])
        table.fail("import", f"none of its photos is one of this project; its names are {names}, …")
    given = table.get("similarity", "same")
    placing: Any = "same"
    if not isinstance(given, dict):
        placing = table.choice("similarity", get_args(Placing), "same")
    points = None
    if placing == "points":
        points = table.path("points"), table.path("scan_points")
    imported = ImportedCameras(
        path,
        reconstruction,
        placing,
        _similarity(table.table("similarity")) if isinstance(given, dict) else None,
        points,
    )
    table.finish()
    return imported


def _similarity(table: Table) -> tuple[float, FloatArray, FloatArray]:
    """Scale, rotation (3,3) and translation (3,) into the scan's world, or the same as a 4 x 4 matrix."""
    if "matrix" in table:
        matrix = np.array(table.matrix("matrix", 4, 4))
        table.finish()
        scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
        if not scale > 0 or not np.allclose(matrix[3], (0, 0, 0, 1)):
            table.fail("matrix", "is no similarity: its last row has to be 0, 0, 0, 1, and it may not mirror")
        return scale, _rotation(table, "matrix", matrix[:3, :3] / scale), matrix[:3, 3]
    scale = table.number("scale", 1e-9, 1e9, 1.0)
    rotation = _rotation(table, "rotation", np.array(table.matrix("rotation", 3, 3)))
    translation = np.array(table.numbers("translation", [3]))
    table.finish()
    return scale, rotation, translation


def _rotation(table: Table, key: str, matrix: FloatArray) -> FloatArray:
    try:
        return checked_rotation(matrix, "similarity")
    except CameraError as error:
        table.fail(key, str(error))
