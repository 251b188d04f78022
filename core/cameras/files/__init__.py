"""Camera files: our own JSON, OpenCV, OCamCalib, COLMAP and Metashape."""

from .colmap import camera_from_colmap, camera_from_colmap_line, colmap_from_camera, colmap_line
from .dictionary import camera_from_dict, camera_to_dict, read_camera_json, write_camera_json
from .metashape import read_metashape, write_metashape
from .ocamcalib import read_ocamcalib, write_ocamcalib
from .opencv import read_opencv, write_opencv
from .reader import read_camera

__all__ = [
    "camera_from_colmap",
    "camera_from_colmap_line",
    "camera_from_dict",
    "camera_to_dict",
    "colmap_from_camera",
    "colmap_line",
    "read_camera",
    "read_camera_json",
    "read_metashape",
    "read_ocamcalib",
    "read_opencv",
    "write_camera_json",
    "write_metashape",
    "write_ocamcalib",
    "write_opencv",
]
