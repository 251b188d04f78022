"""A 3D view as arrays, so that threads can use it, and strokes in it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import bpy
import numpy as np

from ...core.arrays import BoolArray, FloatArray
from ..bridge.world import matrix_to_array


class ViewGeometry:
    """Projection and standpoint of a 3D view."""

    def __init__(self, view: bpy.types.RegionView3D) -> None:
        self.projection = matrix_to_array(view.perspective_matrix)
        self.camera = np.linalg.inv(matrix_to_array(view.view_matrix))
        self.is_perspective = view.is_perspective
        self.distance = float(view.view_distance)

    def on_screen(self, points: FloatArray, width: int, height: int) -> tuple[FloatArray, BoolArray]:
        """Places (N,2) in a region of points (N,3), metres, and whether (N,) they lie before the view."""
        clip = points @ self.projection[:, :3].T + self.projection[:, 3]
        before = clip[:, 3] > 1e-9
        flat = clip[:, :2] / np.where(before, clip[:, 3], 1.0)[:, None]
        return (flat + 1) / 2 * np.array([width, height]), before

    @property
    def right(self) -> FloatArray:
        """Direction (3,) that goes right in the view."""
        return self.camera[:3, 0]

    def origins(self, points: FloatArray) -> FloatArray:
        """Where the rays to points (N,3) come from: the eye (3,), or far before each point (N,3)."""
        if self.is_perspective:
            return self.camera[:3, 3]
        far = 2.0 * float(np.ptp(points, axis=0).max(initial=1.0)) + self.distance
        return points + self.camera[:3, 2] * far

    def faces_it(self, points: FloatArray, normals: FloatArray) -> BoolArray:
        """Which faces (N,) look towards the view: their middles (N,3), metres, and unit normals (N,3)."""
        return np.sum((self.origins(points) - points) * normals, axis=1) > 0


def dense_path(path: Sequence[tuple[float, float]], step: float) -> list[tuple[float, float]]:
    """Places along a stroke at most `step` screen pixels apart: a fast mouse leaves gaps."""
    dense = [path[0]]
    for start, end in itertools.pairwise(path):
        count = max(1, int(np.ceil(np.hypot(end[0] - start[0], end[1] - start[1]) / step)))
        share = np.arange(1, count + 1) / count
        dense += [(start[0] + s * (end[0] - start[0]), start[1] + s * (end[1] - start[1])) for s in share]
    return dense
