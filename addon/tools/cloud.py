"""A point cloud made ready for clicks: which point lies under the mouse, and which ones a view sees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import BoolArray, Float32Array, FloatArray, IndexArray
from ...core.regions.surface.index import SurfaceIndex

if TYPE_CHECKING:
    from .views import ViewGeometry

_REACH = 1.2  # local spacings around a point within which a ray meets it
_SPREAD = 4.0  # times the usual spacing that a point in a sparse place may stand for
_CELL = 2.0  # spacings across a cell of the depth buffer
_DEEP = 2.0  # spacings behind the nearest point of a cell that are seen, too
_STEEPEST = 0.1  # cosine


@dataclass(frozen=True, eq=False)
class PreparedCloud:
    """A point cloud with what clicks on it need: points (V,3) in Blender's world, metres.

    It answers what `PreparedScan` does; its elements are points, not faces.
    """

    index: SurfaceIndex
    vertices: FloatArray

    primitive = "POINTS"

    @property
    def count(self) -> int:
        """Number of points."""
        return len(self.vertices)

    @property
    def spacing(self) -> FloatArray:
        """Distance (V,), m, from each point to those around it."""
        return np.minimum(np.sqrt(self.index.area), _SPREAD * self.index.spacing)

    def corners(self, elements: IndexArray) -> Float32Array:
        """Places (n,3), m, of points, to be drawn."""
        return self.vertices[elements].astype(np.float32)

    def first_hit(self, origins: FloatArray, towards: FloatArray) -> tuple[IndexArray, FloatArray]:
        """Nearest point that each ray of one view meets, -1 for none, and its distance (n,), m.

        Rays (n,3) m, (n,3) that come from one eye, or are parallel.
        """
        towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
        ahead = towards.mean(axis=0)
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, np.eye(3)[np.argmin(np.abs(ahead))])
        axes = np.stack([right, np.cross(ahead, right)], axis=1)
        axes /= np.linalg.norm(axes, axis=0)
        local = self.vertices - origins[0]
        depth = local @ ahead
        from_eye = float(np.ptp(origins, axis=0).max()) < 1e-3 * self.index.spacing
        scale = np.maximum(depth, 1e-9) if from_eye else np.ones_like(depth)
        aim = (towards / (towards @ ahead)[:, None] if from_eye else origins - origins[0]) @ axes
        places, reach = local @ axes / scale[:, None], _REACH * self.spacing / scale
        low, high = aim.min(axis=0), aim.max(axis=0)
        inside = np.all((places >= low - reach[:, None]) & (places <= high + reach[:, None]), axis=1)
        near = np.flatnonzero(inside & (depth > 0))
        hit = nearest_in_reach(aim, places[near], reach[near], depth[near])
        found = np.where(hit >= 0, near[hit] if len(near) else -1, -1)
        along = np.einsum("nk,nk->n", self.vertices[found] - origins, towards)
        return found, np.where(found >= 0, along, np.inf)

    def facing(self, view: ViewGeometry, inside: BoolArray) -> BoolArray:
        """Which of the points `inside` (V,) a view sees; a cloud has no sides."""
        seen = np.zeros_like(inside)
        chosen = np.flatnonzero(inside)
        seen[chosen[self.visible(view, chosen)]] = True
        return seen

    def visible(self, view: ViewGeometry, elements: IndexArray) -> BoolArray:
        """Which of the points (n,) stand before no other ones of them: by a depth buffer of the view."""
        if len(elements) == 0:
            return np.zeros(0, dtype=np.bool_)
        points, spacing = self.vertices[elements], self.spacing[elements]
        side = 1000  # any grid will do that is finer than the cells
        places = view.on_screen(points, side, side)[0]
        beside = view.on_screen(points + spacing[:, None] * view.right, side, side)[0]
        per_metre = np.maximum(np.linalg.norm(beside - places, axis=1) / spacing, 1e-9)
        cell = _CELL * float(np.median(per_metre * spacing))
        eye = view.origins(points)
        ray = points - eye
        depth = np.linalg.norm(ray, axis=1)
        ray /= np.maximum(depth, 1e-9)[:, None]
        if eye.ndim == 2:  # parallel rays, each with an origin of its own
            depth = points @ ray[0]
        column, row = np.floor((places - places.min(axis=0)) / cell).astype(np.int64).T
        which = np.unique(row * (column.max() + 1) + column, return_inverse=True)[1].ravel()
        nearest = np.full(which.max() + 1, np.inf)
        np.minimum.at(nearest, which, depth)
        normal = self.index.normal[elements].astype(np.float64)
        cosine = np.maximum(np.abs(np.einsum("nk,nk->n", ray, normal)), _STEEPEST)
        slope = 1.5 * cell / per_metre * np.sqrt(np.maximum(1 - cosine**2, 0)) / cosine
        return depth <= nearest[which] + _DEEP * spacing + slope


def nearest_in_reach(aim: FloatArray, places: FloatArray, reach: FloatArray, depth: FloatArray) -> IndexArray:
    """Place (k,2) of least depth (k,) that has each aim (n,2) in its reach (k,): its number, -1 for none."""
    hit = np.full(len(aim), -1, dtype=np.int64)
    if len(places) == 0:
        return hit
    tree = cKDTree(places)
    for number, around in enumerate(tree.query_ball_point(aim, float(reach.max()))):
        close = np.array(around, dtype=np.int64)
        close = close[np.linalg.norm(places[close] - aim[number], axis=1) <= reach[close]]
        if len(close):
            hit[number] = close[np.argmin(depth[close])]
    return hit
