"""Reading a scan: by its format, to metres, near the origin, checked."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..arrays import FloatArray
from ..errors import ScanError
from ..jobs import Job, Progress, drain, part
from ..settings import ScanSettings
from .check import Mesh, check_mesh_job
from .clouds import read_e57_job, read_las_job, read_ptx_job
from .meshes import read_mesh_job
from .obj import read_obj_job
from .ply import read_ply_job
from .raw import RawScan
from .scan import Scan

READERS: dict[str, Callable[[Path], Job[RawScan]]] = {
    ".ply": read_ply_job,
    ".obj": read_obj_job,
    ".gltf": read_mesh_job,
    ".glb": read_mesh_job,
    ".stl": read_mesh_job,
    ".e57": read_e57_job,
    ".las": read_las_job,
    ".laz": read_las_job,
    ".ptx": read_ptx_job,
}
"""Reader of every scan format, by lower-case file suffix."""


_LARGEST = 1000.0
"""Metres across beyond which the unit of a scan is asked about."""

_SMALLEST = 0.02
"""Metres across below which the unit that the user told is asked about: less than a coin."""


def read_scan_job(path: Path | str, settings: ScanSettings | None = None) -> Job[Scan]:
    """Read and check a scan.

    Coordinates become metres with z up; on axes where they exceed `settings.offset_limit` an offset is split
    off (`world = vertices + offset`). What was found and mended stands in `Scan.report`. Raises ScanError
    with the reason when the file is missing, damaged, of an unknown format, or holds nothing usable.
    """
    path, settings = Path(path), settings or ScanSettings()
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise ScanError(
            f"{path}: unknown scan format “{path.suffix}”; known are {', '.join(sorted(READERS))}"
        )
    if not path.is_file():
        raise ScanError(f"{path}: no such file")
    try:
        raw = yield from part(reader(path), 0.0, 0.6)
    except OSError as error:
        raise ScanError(f"{path}: cannot be read ({error.strerror or error})") from error
    yield Progress(0.6, "Choosing the offset")
    world = _metric(raw, settings)
    offset = _offset(world, settings)
    world -= offset
    notes = _precision_note(raw, offset, settings) + list(raw.report)
    mesh = Mesh(
        world, raw.faces, raw.file_faces, raw.vertex_colors, raw.intensity, dict(raw.face_sets), notes
    )
    yield from part(check_mesh_job(mesh, settings, str(path)), 0.65, 1.0)
    mesh.report += _size_note(mesh.vertices, settings)
    return Scan(
        mesh.vertices,
        mesh.faces,
        offset,
        mesh.file_faces,
        raw.file_face_count,
        name=path.stem,
        path=path,
        vertex_colors=mesh.vertex_colors,
        intensity=mesh.intensity,
        face_sets=mesh.face_sets,
        report=tuple(mesh.report),
    )


def read_scan(path: Path | str, settings: ScanSettings | None = None) -> Scan:
    """Read and check a scan, see `read_scan_job`."""
    return drain(read_scan_job(path, settings))


def _metric(raw: RawScan, settings: ScanSettings) -> FloatArray:
    """Vertices (V,3) in metres with z up; a y-up file is turned by 90° about x: (x, y, z) -> (x, -z, y)."""
    vertices = raw.vertices * settings.unit
    y_up = raw.y_up if settings.up == "auto" else settings.up == "y"
    if y_up:
        vertices = np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=1)
    return vertices


def _offset(world: FloatArray, settings: ScanSettings) -> FloatArray:
    """Offset (3,): the middle of the scan in whole 100 m, on axes with large coordinates only."""
    if settings.offset is not None:
        return np.array(settings.offset, dtype=np.float64)
    fine = np.isfinite(world).all(axis=1)
    if not fine.any():
        return np.zeros(3)
    middle = np.median(world[fine][:: max(1, len(world) // 100_000)], axis=0)
    offset: FloatArray = np.where(np.abs(middle) > settings.offset_limit, np.round(middle, -2), 0.0)
    return offset


def _size_note(vertices: FloatArray, settings: ScanSettings) -> list[str]:
    """Question about the unit of a scan that is very large in metres, or very small in the unit told."""
    extent = float(np.ptp(vertices, axis=0).max())
    if settings.unit < 1.0 and extent < _SMALLEST:
        return [f"The scan is {1000 * extent:.1f} mm across: is its unit right? Else all lengths are wrong."]
    if settings.unit != 1.0 or extent <= _LARGEST:
        return []
    return [
        f'The scan is {extent:.0f} m across: is its unit mm? Then set unit = "mm" (in [scan] of a project '
        "file), else all lengths are wrong."
    ]


def _precision_note(raw: RawScan, offset: FloatArray, settings: ScanSettings) -> list[str]:
    """Sentences about large coordinates; a single-precision file has lost digits already."""
    if not offset.any():
        return []
    notes = [f"Large coordinates: moved by an offset of {', '.join(f'{x:.0f}' for x in offset)} m."]
    largest = float(np.abs(offset).max())
    step = float(np.spacing(np.float32(largest / settings.unit))) * settings.unit
    if raw.single_precision and settings.offset is None:
        notes.append(
            f"The file keeps single precision: at {largest:.0f} m its coordinates come in steps of "
            f"{1000 * step:.3g} mm. Export it in double precision or with an offset."
        )
    return notes
