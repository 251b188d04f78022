"""Cameras with their poses from and to other programs."""

from .bundler import read_bundler, read_bundler_list, read_nvm, write_bundler
from .colmap import read_colmap, write_colmap
from .formats import WRITE_FORMATS, read_reconstruction, write_reconstruction
from .metashape import read_metashape_cameras, write_metashape_cameras
from .realityscan import (
    read_realityscan_csv,
    read_realityscan_xmp,
    write_realityscan_csv,
    write_realityscan_xmp,
)
from .reconstruction import PosedCamera, Reconstruction
from .sfm_data import read_sfm_data

__all__ = [
    "WRITE_FORMATS",
    "PosedCamera",
    "Reconstruction",
    "read_bundler",
    "read_bundler_list",
    "read_colmap",
    "read_metashape_cameras",
    "read_nvm",
    "read_realityscan_csv",
    "read_realityscan_xmp",
    "read_reconstruction",
    "read_sfm_data",
    "write_bundler",
    "write_colmap",
    "write_metashape_cameras",
    "write_realityscan_csv",
    "write_realityscan_xmp",
    "write_reconstruction",
]
