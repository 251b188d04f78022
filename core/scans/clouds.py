"""Point clouds: LAS and LAZ (laspy), E57 (pye57), PTX."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from ..arrays import AnyArray, ByteArray, Float32Array, FloatArray
from ..errors import ScanError
from ..jobs import Job, Progress
from .raw import RawScan, color_bytes, no_faces

_POINTS = 1_000_000
"""Points read in one step."""


def read_las_job(path: Path) -> Job[RawScan]:
    """Read a LAS or LAZ file. Raises ScanError for a damaged file."""
    import laspy  # half a second that only those pay who read such a file

    yield Progress(0.0, f"Reading {path.name}")
    points, colors, intensity = [], [], []
    try:
        with laspy.open(str(path)) as reader:
            names = set(reader.header.point_format.dimension_names)
            total = max(reader.header.point_count, 1)
            done = 0
            for chunk in reader.chunk_iterator(_POINTS):
                points.append(np.stack([chunk.x, chunk.y, chunk.z], axis=1))
                intensity.append(np.asarray(chunk.intensity, dtype=np.float32))
                if {"red", "green", "blue"} <= names:
                    colors.append(np.stack([chunk.red, chunk.green, chunk.blue], axis=1))
                done += len(chunk)
                yield Progress(0.9 * done / total, f"Reading {path.name}")
            if done < reader.header.point_count:
                raise ScanError(f"{path}: holds {done} of {total} points; it is cut off, copy it again")
    except (laspy.errors.LaspyException, RuntimeError, ValueError, EOFError) as error:
        raise _damaged(path, error) from error
    return _cloud(points, colors, intensity)


def read_e57_job(path: Path) -> Job[RawScan]:
    """Read all scans of an E57 file, each placed by its pose. Raises ScanError for a damaged file."""
    import pye57

    yield Progress(0.0, f"Reading {path.name}")
    points, colors, intensity = [], [], []
    try:
        with pye57.E57(str(path)) as file:
            for number in range(file.scan_count):
                yield Progress(0.9 * number / file.scan_count, f"Reading scan {number + 1} of {path.name}")
                data = file.read_scan(number, intensity=True, colors=True, ignore_missing_fields=True)
                points.append(np.stack([data[f"cartesian{axis}"] for axis in "XYZ"], axis=1))
                if "intensity" in data:
                    intensity.append(np.asarray(data["intensity"], dtype=np.float32))
                if "colorRed" in data:
                    colors.append(np.stack([data[f"color{c}"] for c in ("Red", "Green", "Blue")], axis=1))
    except (pye57.libe57.E57Exception, RuntimeError, ValueError) as error:
        raise _damaged(path, error) from error
    return _cloud(points, colors, intensity)


def read_ptx_job(path: Path) -> Job[RawScan]:
    """Read all scans of a PTX file; directions without return (0, 0, 0) are left out.

    Every scan has 10 lines of header: columns, rows, position, three axes, and a 4x4 matrix for row vectors,
    `(x, y, z, 1) @ matrix`. Raises ScanError for a damaged file.
    """
    points, colors, intensity = [], [], []
    size = max(path.stat().st_size, 1)
    done = 0
    with path.open(encoding="ascii", errors="replace") as file:
        try:
            for matrix, rows in _ptx_blocks(path, file):
                measured = (rows[:, :3] != 0).any(axis=1)
                homogeneous = np.concatenate([rows[:, :3], np.ones((len(rows), 1))], axis=1)
                points.append((homogeneous @ matrix)[measured, :3])
                intensity.append(rows[measured, 3].astype(np.float32))
                if rows.shape[1] >= 7:
                    colors.append(rows[measured, 4:7].astype(np.uint8))
                done += rows.size * 8  # a number takes about eight characters
                yield Progress(min(0.9, done / size), f"Reading {path.name}")
        except ValueError as error:
            raise _damaged(path, error) from error
    return _cloud(points, colors, intensity)


def _ptx_blocks(path: Path, file: TextIO) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Matrix (4,4) and lines (N,4 or 7) of every scan, in blocks."""
    while first := file.readline().strip():
        header = [first, *islice((line.strip() for line in file), 9)]
        if len(header) < 10:
            raise ValueError("the header of a scan is cut off")
        count = int(header[0]) * int(header[1])
        matrix = np.array([[float(word) for word in line.split()] for line in header[6:10]])
        if matrix.shape != (4, 4):
            raise ValueError("a scan has no 4 x 4 matrix")
        while count > 0:
            lines = list(islice(file, min(count, _POINTS)))
            if not lines:
                raise ValueError(f"{count} points of a scan are missing; the file is cut off")
            count -= len(lines)
            yield matrix, np.loadtxt(lines, ndmin=2)


def _cloud(
    points: Sequence[FloatArray], colors: Sequence[AnyArray], intensity: Sequence[Float32Array]
) -> RawScan:
    """Join parts; colours or intensity that only some parts have are left out, and told."""
    report = [
        f"Only some of the scans have {what}: it is left out."
        for what, parts in (("colour", colors), ("intensity", intensity))
        if 0 < len(parts) < len(points)
    ]
    return RawScan(
        np.concatenate(points) if points else np.empty((0, 3)),
        no_faces(),
        np.empty(0, dtype=np.int32),
        0,
        vertex_colors=_joined_colors(colors) if len(colors) == len(points) and colors else None,
        intensity=np.concatenate(intensity) if len(intensity) == len(points) and intensity else None,
        report=tuple(report),
    )


def _joined_colors(colors: Sequence[AnyArray]) -> ByteArray:
    return color_bytes(np.concatenate(colors))


def _damaged(path: Path, error: Exception) -> ScanError:
    kind, reason = path.suffix[1:].upper(), str(error).partition("\n")[0]
    return ScanError(f"{path}: not a readable {kind} file ({reason}); it may be cut off, copy it again")
