"""Regions of photos and of the surface, and how to find them."""

from .image_region import ImageRegion
from .surface_region import SurfaceRegion

__all__ = ["ImageRegion", "SurfaceRegion"]
