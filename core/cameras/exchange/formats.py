"""One reader and one writer for all programs: names and contents of files tell whose they are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ...errors import CameraError
from .bundler import read_bundler, read_bundler_list, read_nvm, write_bundler
from .colmap import read_colmap, write_colmap
from .metashape import read_metashape_cameras, write_metashape_cameras
from .realityscan import (
    read_realityscan_csv,
    read_realityscan_xmp,
    write_realityscan_csv,
    write_realityscan_xmp,
)
from .reconstruction import Reconstruction, SizeOf
from .sfm_data import read_sfm_data

_COLMAP_FOLDERS = ("", "sparse/0", "sparse", "0")
_BUNDLER_LISTS = ("list.txt", "../list.txt")


def _unknown_size(name: str) -> tuple[int, int]:
    raise CameraError(f"The file does not tell the size of {name}: give the folder of the photos.")


def read_reconstruction(path: Path | str, size_of: SizeOf = _unknown_size) -> Reconstruction:
    """Posed photos from any program's file or folder.

    Parameters
    ----------
    path
        A folder with a COLMAP model (or its parent) or with RealityScan's XMP files, Metashape's .xml,
        RealityScan's .csv or one .xmp, Bundler's .out with its list.txt, an .nvm, or a .json / .sfm of
        OpenMVG or AliceVision.
    size_of
        (width, height) of a photo by its name in the file; RealityScan, Bundler and NVM files do not tell it.

    Raises
    ------
    CameraError
        Files that are none of these or make no sense, or that need sizes when `size_of` is not given.
    """
    path = Path(path)
    if path.is_dir():
        return _read_folder(path, size_of)
    readers: dict[str, Callable[[], Reconstruction]] = {
        ".xml": lambda: read_metashape_cameras(path),
        ".csv": lambda: read_realityscan_csv(path, size_of),
        ".xmp": lambda: read_realityscan_xmp([path], size_of),
        ".out": lambda: read_bundler(path, read_bundler_list(_bundler_list(path)), size_of),
        ".nvm": lambda: read_nvm(path, size_of),
        ".json": lambda: read_sfm_data(path),
        ".sfm": lambda: read_sfm_data(path),
    }
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise CameraError(f"{path}: cameras are read from folders and from {', '.join(readers)} files.")
    return reader()


def _read_folder(folder: Path, size_of: SizeOf) -> Reconstruction:
    for name in _COLMAP_FOLDERS:
        if any((folder / name / f"cameras.{suffix}").exists() for suffix in ("bin", "txt")):
            return read_colmap(folder / name)
    sidecars = sorted(folder.glob("*.xmp"))
    if sidecars:
        return read_realityscan_xmp(sidecars, size_of)
    raise CameraError(f"{folder} has neither a COLMAP model nor XMP files of RealityScan.")


def _bundler_list(path: Path) -> Path:
    for name in _BUNDLER_LISTS:
        if (path.parent / name).exists():
            return path.parent / name
    raise CameraError(f"{path} needs the list of its photos: put list.txt beside it.")


_WRITERS: dict[str, Callable[[Path, Reconstruction], None]] = {
    "colmap": write_colmap,
    "colmap-binary": lambda path, reconstruction: write_colmap(path, reconstruction, binary=True),
    "metashape": write_metashape_cameras,
    "realityscan-xmp": write_realityscan_xmp,
    "realityscan-csv": write_realityscan_csv,
    "bundler": lambda path, reconstruction: write_bundler(path, path.parent / "list.txt", reconstruction),
}
WRITE_FORMATS = tuple(_WRITERS)
"""Formats that `write_reconstruction` knows."""


def write_reconstruction(path: Path | str, reconstruction: Reconstruction, file_format: str) -> None:
    """Write posed photos for another program.

    Parameters
    ----------
    path
        A folder for colmap, colmap-binary and realityscan-xmp, else a file; list.txt goes beside Bundler's.
    reconstruction
        Photos and points.
    file_format
        One of `WRITE_FORMATS`.

    Raises
    ------
    CameraError
        An unknown format, or cameras that the program has no model for.
    OutputError
        Files that cannot be written.
    """
    if file_format not in _WRITERS:
        raise CameraError(f"'{file_format}' is not one of {', '.join(WRITE_FORMATS)}.")
    _WRITERS[file_format](Path(path), reconstruction)
