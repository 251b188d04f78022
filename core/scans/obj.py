"""OBJ files: vertices, polygons, and their objects and groups; materials are left alone."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import numpy as np

from ..arrays import BoolArray, ByteArray, FloatArray, IndexArray, IntArray
from ..errors import ScanError
from ..jobs import Job, Progress
from .raw import RawScan, color_bytes, cut_polygons, no_faces

_TEXTURE_AND_NORMAL = re.compile(rb"/[^ \t\r\n]*")
_CHUNK = 8 << 20
"""Bytes of text parsed in one step."""


@dataclass
class _Parts:
    """What has been read so far; `ranges` are the polygons (first, last + 1) of every name."""

    vertices: list[FloatArray] = field(default_factory=list)
    vertex_count: int = 0
    corners: list[IndexArray] = field(default_factory=list)
    counts: list[IndexArray] = field(default_factory=list)
    polygon_count: int = 0
    names: dict[str, list[str]] = field(default_factory=lambda: {"o": [], "g": []})
    named_since: int = 0
    ranges: dict[str, list[tuple[int, int]]] = field(default_factory=dict)


def read_obj_job(path: Path) -> Job[RawScan]:
    """Read an OBJ file; objects (`o`) and groups (`g`) become face sets.

    Colours after the coordinates of a vertex (0..1, as MeshLab and CloudCompare write them) are read.
    Raises ScanError for text that is not OBJ.
    """
    yield Progress(0.0, f"Reading {path.name}")
    parts = _Parts()
    done, size = 0, max(path.stat().st_size, 1)
    for chunk in _chunks(path):
        try:
            _take(parts, chunk)
        except (ValueError, IndexError) as error:
            reason = f"{path}: not a readable OBJ file within bytes {done} to {done + len(chunk)} ({error})"
            raise ScanError(reason) from None
        done += len(chunk)
        yield Progress(0.9 * min(done / size, 1.0), f"Reading {path.name}")
    _close_names(parts)
    return _assemble(path, parts)


def _chunks(path: Path) -> Iterator[bytes]:
    """Pieces of the text that end with a line; a backslash joins a line to the next."""
    rest = b""
    with path.open("rb") as file:
        while block := file.read(_CHUNK):
            rest += block
            end = rest.rfind(b"\n") + 1
            while end and rest[:end].endswith((b"\\\n", b"\\\r\n")):
                end = rest.rfind(b"\n", 0, end - 1) + 1
            if end:
                yield rest[:end].replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
                rest = rest[end:]
    if rest.strip():
        yield rest + b"\n"


def _take(parts: _Parts, chunk: bytes) -> None:
    """Sort the lines of a piece by their kind and read each kind at once."""
    data = np.frombuffer(chunk, dtype=np.uint8)
    ends = np.flatnonzero(data == ord("\n")) + 1
    starts = np.concatenate([[0], ends[:-1]])
    lengths = ends - starts
    first, second = data[starts], data[np.minimum(starts + 1, len(data) - 1)]
    spaced = (second == ord(" ")) | (second == ord("\t"))
    is_vertex, is_face = (first == ord("v")) & spaced, (first == ord("f")) & spaced
    vertices_before = parts.vertex_count + np.cumsum(is_vertex)[is_face]
    polygons_before = parts.polygon_count + np.cumsum(is_face)
    for line in np.flatnonzero(((first == ord("o")) | (first == ord("g"))) & (spaced | (lengths <= 2))):
        _take_name(parts, chunk[starts[line] : ends[line]], int(polygons_before[line]))
    if is_vertex.any():
        _take_vertices(parts, _lines(data, is_vertex, lengths))
    if is_face.any():
        _take_faces(parts, _lines(data, is_face, lengths), vertices_before)


def _lines(data: ByteArray, chosen: BoolArray, lengths: IndexArray) -> bytes:
    """Return the chosen lines without their keyword letter."""
    return data[np.repeat(chosen, lengths)].tobytes().replace(b"v", b" ").replace(b"f", b" ")


def _take_name(parts: _Parts, line: bytes, polygons_before: int) -> None:
    kind, _, names = line.decode("utf-8", errors="replace").strip().partition(" ")
    _close_names(parts, polygons_before)
    # An object's name may contain spaces; a face may be in several groups.
    parts.names[kind] = [names.strip()] if kind == "o" else names.split()


def _close_names(parts: _Parts, polygons: int | None = None) -> None:
    """Give the polygons since the last name line to the names that hold for them."""
    end = parts.polygon_count if polygons is None else polygons
    for name in {*parts.names["o"], *parts.names["g"]} - {"", "default", "off"}:
        if end > parts.named_since:
            parts.ranges.setdefault(name, []).append((parts.named_since, end))
    parts.named_since = end


def _take_vertices(parts: _Parts, text: bytes) -> None:
    try:
        rows = np.loadtxt(BytesIO(text), ndmin=2)
    except ValueError:  # some lines have colours, some not
        rows = np.loadtxt(BytesIO(text), ndmin=2, usecols=(0, 1, 2))
    parts.vertices.append(rows)
    parts.vertex_count += len(rows)


def _take_faces(parts: _Parts, text: bytes, vertices_before: IndexArray) -> None:
    """Add polygons; a negative index counts back from the last vertex read before its line."""
    text = _TEXTURE_AND_NORMAL.sub(b"", text) if b"/" in text else text
    try:
        rows = np.loadtxt(BytesIO(text), dtype=np.int64, ndmin=2)
        corners, counts = rows.ravel(), np.full(len(rows), rows.shape[1])
    except ValueError:  # polygons of different length
        counts = np.array([len(line.split(b"#")[0].split()) for line in text.splitlines()])
        corners = np.array([int(i) for line in text.splitlines() for i in line.split(b"#")[0].split()])
    if (corners == 0).any():
        raise ValueError("a face refers to vertex 0, but OBJ counts from 1")
    relative = np.repeat(vertices_before, counts) + corners
    parts.corners.append(np.where(corners < 0, relative, corners - 1))
    parts.counts.append(counts)
    parts.polygon_count += len(counts)


def _assemble(path: Path, parts: _Parts) -> RawScan:
    if not parts.vertices:
        raise ScanError(f"{path}: the OBJ file has no vertices")
    columns = min(rows.shape[1] for rows in parts.vertices)
    if columns < 3:
        raise ScanError(f"{path}: the vertices of the OBJ file have fewer than three coordinates")
    vertices = np.concatenate([rows[:, :3] for rows in parts.vertices])
    colors = None
    if columns >= 6:
        channels = np.concatenate([rows[:, 3:6] for rows in parts.vertices])
        colors = color_bytes(channels if channels.max(initial=0.0) <= 1.0 else channels / 255.0)
    if not parts.polygon_count:
        return RawScan(vertices, no_faces(), np.empty(0, dtype=np.int32), 0, vertex_colors=colors)
    faces, owner = cut_polygons(np.concatenate(parts.corners), np.concatenate(parts.counts))
    sets = {name: _triangles_of(ranges, owner) for name, ranges in parts.ranges.items()}
    return RawScan(vertices, faces, owner, parts.polygon_count, vertex_colors=colors, face_sets=sets)


def _triangles_of(ranges: list[tuple[int, int]], owner: IntArray) -> IntArray:
    """Triangles cut from the polygons of the given ranges; `owner` is ascending."""
    bounds = np.searchsorted(owner, np.array(ranges).ravel()).reshape(-1, 2)
    return np.concatenate([np.arange(start, end, dtype=np.int32) for start, end in bounds])
