"""Openings of the scan: windows, doors and niches have an outline, but no faces."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay

from ...arrays import ArrayLike, BoolArray, FloatArray, IndexArray
from ...errors import RegionError
from ...geometry.outlines import loop_area
from ...geometry.polygons import polygon_areas
from ..image_region import described
from ..surface_region import SurfaceRegion
from .robust_fit import fit_plane


def opening_region(outline: ArrayLike, name: str = "") -> SurfaceRegion:
    """Surface that spans an outline (n,3) in metres, wound as the outline is.

    Raises
    ------
    RegionError
        The outline has less than three corners, coordinates that are no numbers, or no area.
    """
    corners = np.asarray(outline, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 3 or len(corners) < 3 or not np.isfinite(corners).all():
        raise RegionError(f"The outline of {described(name)} needs three or more corners [x, y, z].")
    plane = fit_plane(corners, share=1.0)
    flat = (corners - plane.centre) @ plane.axes[:2].T
    if loop_area([flat]) < 0:
        flat = flat * np.array([1.0, -1.0])
    triangles = triangulated(flat)
    if len(triangles) == 0:
        raise RegionError(f"The outline of {described(name)} has no area, or crosses itself.")
    return SurfaceRegion(corners, triangles, name)


def triangulated(corners: FloatArray) -> IndexArray:
    """Triangles (F,3) inside a simple polygon (n,2)."""
    triangles: IndexArray = Delaunay(corners).simplices.astype(np.int64)
    large = polygon_areas(corners[triangles]) > 1e-9 * float(np.ptp(corners, axis=0).max()) ** 2
    return triangles[large & points_inside(corners, corners[triangles].mean(axis=1))]


def points_inside(polygon: FloatArray, points: FloatArray) -> BoolArray:
    """Whether points (N,2) lie in a polygon (n,2), by the even-odd rule."""
    inside = np.zeros(len(points), dtype=np.bool_)
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        crosses = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
        if a[1] != b[1]:
            inside ^= crosses & (points[:, 0] < a[0] + (points[:, 1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
    return inside
