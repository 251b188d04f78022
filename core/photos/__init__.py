"""Photographs: files, EXIF, intrinsics, masks."""

from .exif import Exif, read_exif
from .image import SUFFIXES, check_complete, image_size, read_deep_image, read_image
from .intrinsics import camera_from_exif, camera_matrix, focal_from_sensor
from .marks import (
    RegionMark,
    check_mask,
    check_outline,
    polygons_to_geojson,
    read_mask,
    read_polygons,
    touches_frame,
)
from .photo import Photo, open_photo
from .view import View

__all__ = [
    "SUFFIXES",
    "Exif",
    "Photo",
    "RegionMark",
    "View",
    "camera_from_exif",
    "camera_matrix",
    "check_complete",
    "check_mask",
    "check_outline",
    "focal_from_sensor",
    "image_size",
    "open_photo",
    "polygons_to_geojson",
    "read_deep_image",
    "read_exif",
    "read_image",
    "read_mask",
    "read_polygons",
    "touches_frame",
]
