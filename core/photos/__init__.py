"""Photographs: files, EXIF, intrinsics, masks."""

from .view import View

__all__ = ["View"]
