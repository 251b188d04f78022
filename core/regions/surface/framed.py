"""A region within an outline seen from the front: the faces there, near its surface and not turned away."""

from __future__ import annotations

import numpy as np

from ...arrays import BoolArray, FloatArray
from ...geometry.polygons import polygon_areas
from .growing import SurfaceLevel
from .index import SurfaceIndex
from .robust_fit import SurfaceFit

_SCATTERS = 6.0  # of the surface inside an outline, that a face may be off it
_LEAST = (6.0, 0.1)  # how far it may be off at least: in noises of the scan, and in half widths
_BACK = -0.2  # cosine to the plane's normal below which a face is turned away
_DEEP = 1.0  # half widths in front of and behind the plane where its surface is looked for
_FACING = 0.7  # cosine to the plane's normal of what tells where the surface is


def framed_level(index: SurfaceIndex, plane: SurfaceFit, outline: FloatArray, score: float) -> SurfaceLevel:
    """Region within a convex outline (n,2) m on a plane; its fit is parallel to that."""
    area = float(polygon_areas(outline[None])[0])
    half = 2 * area / float(np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1).sum())
    patches = index.patches
    radius = float(np.linalg.norm(outline, axis=1).max())  # about the plane's centre
    members = np.flatnonzero(np.abs(patches.middle - plane.centre).max(axis=1) <= radius + _DEEP * half)
    local = (patches.middle[members] - plane.centre) @ plane.axes.T
    inside = within(local[:, :2], outline) & (np.abs(local[:, 2]) < _DEEP * half)
    members, local = members[inside], local[inside]
    height = local[patches.normal[members] @ plane.normal > _FACING, 2]
    middle = float(np.median(height)) if len(height) else 0.0
    scatter = 1.4826 * float(np.median(np.abs(height - middle))) if len(height) else 0.0
    reach = float(np.clip(_SCATTERS * scatter, max(_LEAST[0] * index.noise, _LEAST[1] * half), _DEEP * half))
    fit = SurfaceFit(plane.centre + middle * plane.normal, plane.axes, np.zeros(6), scatter)
    members = members[np.abs(local[:, 2] - middle) < reach]
    return SurfaceLevel(members, area, reach, score, fit, outline)


def framed_faces(index: SurfaceIndex, level: SurfaceLevel) -> BoolArray:
    """Set of faces (F,) of a level with an outline."""
    if level.outline is None:
        raise ValueError("a level without outline is grown")
    patches, fit = index.patches, level.fit
    local = (patches.middle - fit.centre) @ fit.axes.T
    low, high = level.outline.min(axis=0) - patches.width, level.outline.max(axis=0) + patches.width
    near = np.all((local[:, :2] > low) & (local[:, :2] < high), axis=1)
    near &= np.abs(local[:, 2]) < level.tolerance + patches.width
    faces = patches.faces(np.flatnonzero(near))
    place = (index.middle[faces] - fit.centre) @ fit.axes.T
    usable = (np.abs(place[:, 2]) < level.tolerance) & (index.normal[faces] @ fit.normal > _BACK)
    inside = np.zeros(index.face_count, dtype=np.bool_)
    inside[faces] = usable & within(place[:, :2], level.outline)
    return inside


def within(points: FloatArray, outline: FloatArray) -> BoolArray:
    """Whether points (N,2) lie within a convex outline (n,2), of which corners may coincide."""
    vector = np.roll(outline, -1, axis=0) - outline
    middle = outline.mean(axis=0)
    inside = np.ones(len(points), dtype=np.bool_)
    for corner, way in zip(outline, vector, strict=True):
        normal = np.array([-way[1], way[0]])
        normal *= np.sign(normal @ (middle - corner))
        inside &= (points - corner) @ normal >= 0
    return inside
