"""Maps of a textured scan that need the poses: how far the texture may lie off, face by face."""

from __future__ import annotations

import numpy as np

from ...arrays import Float32Array, FloatArray
from ...geometry.meshes import face_normals
from ...pose.points.shift import predicted_shift
from ...pose.pose import Pose
from .textures import TexturedScan

_FACES = 1 << 17
"""Faces looked at together; bounds the memory."""


def texture_shift(textured: TexturedScan) -> Float32Array:
    """Standard deviation (m) on the surface of where a face's photo lies, from the photo's pose: (F,).

    NaN where no photo sees the face or nothing is known of its pose's uncertainty.
    """
    out = np.full(len(textured.faces), np.nan, dtype=np.float32)
    for number, view in enumerate(textured.views):
        if view.covariance is None:
            continue
        pose = Pose(view.rotation, view.translation, view.covariance)
        faces = np.flatnonzero(textured.selection.view == number)
        for start in range(0, len(faces), _FACES):
            chosen = faces[start : start + _FACES]
            triangles = textured.faces[chosen]
            normals = face_normals(textured.vertices, triangles)[0]
            centroids = textured.vertices[triangles].mean(axis=1)
            out[chosen] = predicted_shift(pose, centroids, normals) / 1000.0
    return out


def median_over_area(values: FloatArray | Float32Array, areas: FloatArray) -> float | None:
    """Median of values (N,) by the area (N,) that has them; None where none is known."""
    known = np.isfinite(values) & (areas > 0)
    if not known.any():
        return None
    order = np.argsort(values[known])
    total = np.cumsum(areas[known][order])
    middle = min(int(np.searchsorted(total, 0.5 * total[-1])), len(order) - 1)
    return float(values[known][order][middle])
