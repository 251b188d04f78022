"""Which points of a cloud a photo sees: by a depth buffer of splats, or by Hidden Point Removal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from ...arrays import ArrayLike, BoolArray, FloatArray, IndexArray
from ...cameras.base import Camera
from ...errors import TextureError
from ...photos.view import View
from .splats import Splats, measure_splats, tangents
from .visibility import project

_CELLS_PER_SPLAT = 2.0
"""Cells from the middle of a splat to its end, in the median: finer ones changed nothing."""
_WIDEST_SPLAT = 4
"""Half-width in cells up to which a splat is drawn; nearer ones would cover more of the picture."""
_STEEPEST = 0.05
"""Splats seen at a smaller cosine hide nothing: they are thin lines in the picture."""
_SLACK = 0.75
"""Cells by which a ray may pass a point: half a cell, and some more."""
_DEPTH = 0.8
"""Depth behind a splat, in distances to the third neighbour, that still counts as the same surface."""

Method = Literal["depth", "hull"]


def visible_points(
    points: ArrayLike,
    normals: ArrayLike | None,
    view: View,
    method: Method = "depth",
    gamma: float = 3.0,
    splats: Splats | None = None,
) -> BoolArray:
    """Whether a photo sees each point of a cloud: (N,3) m, unit normals (N,3) or None, -> (N,).

    "depth" needs normals: every point is a splat that covers its neighbourhood; points behind splats are
    hidden and so are those that look away. "hull" is Katz's Hidden Point Removal, which needs none, with a
    flipping radius of `10 ** gamma` times the farthest point; with normals those that look away are hidden.
    The cloud's `splats` are measured when not given. Raises TextureError.
    """
    cloud = np.asarray(points, dtype=np.float64)
    inside = view.camera.in_frame(project(view, cloud))
    towards = view.centre - cloud
    if normals is not None:
        inside &= np.einsum("nk,nk->n", towards, np.asarray(normals, dtype=np.float64)) > 0
    candidates = np.flatnonzero(inside)
    visible = np.zeros(len(cloud), dtype=np.bool_)
    if len(candidates) == 0:
        return visible
    if method == "hull":
        kept = _on_hull(cloud - view.centre, gamma)[candidates]
    elif normals is None:
        raise TextureError("The depth buffer needs the points' normals; compute them or use the hull method.")
    else:
        local = cloud[candidates] - view.centre
        normal = np.asarray(normals, dtype=np.float64)[candidates]
        splats = splats or measure_splats(cloud, normals)
        kept = _in_depth_buffer(local, normal, view, splats.of(candidates))
    visible[candidates] = kept
    return visible


def point_spacing(points: FloatArray, sample: int = 5000) -> float:
    """Median distance (m) to the third neighbour of a cloud's points (N,3), from a sample of them."""
    if len(points) < 4:
        return 1.0
    chosen = points[:: max(1, len(points) // sample)]
    distance = np.asarray(cKDTree(points - points[0]).query(chosen - points[0], k=4)[0])
    return float(np.median(distance[:, 3]))


def _on_hull(local: FloatArray, gamma: float) -> BoolArray:
    """Points visible from the origin: spherical flipping and convex hull. Source: Katz et al. 2007."""
    distance = np.linalg.norm(local, axis=1)
    radius = float(distance.max()) * 10.0**gamma
    safe = np.maximum(distance, 1e-12)
    flipped = local + 2 * ((radius - distance) / safe)[:, None] * local
    visible = np.zeros(len(local), dtype=np.bool_)
    try:
        hull = ConvexHull(np.concatenate([flipped / radius, np.zeros((1, 3))]))
    except QhullError:  # fewer than four points, or all in a plane with the camera: nothing hides them
        return np.ones(len(local), dtype=np.bool_)
    visible[hull.vertices[hull.vertices < len(local)]] = True
    return visible


def _in_depth_buffer(local: FloatArray, normal: FloatArray, view: View, splats: Splats) -> BoolArray:
    """Visibility of points (n,3), relative to the camera's centre, among each other.

    Splats much larger in the picture than the others are drawn with larger cells, so that none has holes.
    """
    distance = np.linalg.norm(local, axis=1)
    reach = _pixels_per_radian(view.camera) * splats.reach.max(axis=1) / distance
    finest = max(1.0, float(np.median(reach)) / _CELLS_PER_SPLAT)
    level = np.ceil(np.log2(np.maximum(reach / (finest * _WIDEST_SPLAT), 1.0))).astype(np.int64)
    pixel = view.camera.project(local @ np.asarray(view.rotation, dtype=np.float64).T)
    scene = _Scene(local, distance, normal, *tangents(normal), pixel, reach, splats)
    visible = np.ones(len(local), dtype=np.bool_)
    for number in np.unique(level):
        visible &= scene.in_front_of(np.flatnonzero(level == number), view, finest * 2.0**number)
    return visible


@dataclass(frozen=True, eq=False)
class _Scene:
    """Points (n,3) m from the camera's centre, their tangents, `pixel` (n,2), and splats' `reach` in px."""

    local: FloatArray
    distance: FloatArray
    normal: FloatArray
    first: FloatArray
    second: FloatArray
    pixel: FloatArray
    reach: FloatArray
    splats: Splats

    def in_front_of(self, drawn: IndexArray, view: View, cell: float) -> BoolArray:
        """Whether points (n,) lie before the splats of those `drawn` with cells of `cell` px."""
        columns, rows = int(view.camera.width / cell) + 1, int(view.camera.height / cell) + 1
        column = np.clip((self.pixel[:, 0] + 0.5) / cell, 0, columns - 1).astype(np.int64)
        row = np.clip((self.pixel[:, 1] + 0.5) / cell, 0, rows - 1).astype(np.int64)
        rays = _cell_rays(view.camera, np.asarray(view.rotation, dtype=np.float64), cell, columns, rows)
        buffer = np.full(columns * rows, np.inf)
        extent = np.ceil(self.reach[drawn] / cell)
        for dv in range(-_WIDEST_SPLAT, _WIDEST_SPLAT + 1):
            for du in range(-_WIDEST_SPLAT, _WIDEST_SPLAT + 1):
                u, v = column[drawn] + du, row[drawn] + dv
                inside = (max(abs(du), abs(dv)) <= extent) & (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
                self._draw(buffer, (v * columns + u)[inside], rays, drawn[inside])
        plane = np.einsum("nk,nk->n", self.normal, self.local)
        cosine = np.maximum(-plane / self.distance, _STEEPEST)
        # A cell's ray passes the point at up to half a cell; on a slope its depth differs by as much.
        slope = self.distance * (cell / _pixels_per_radian(view.camera)) * np.sqrt(1 - cosine**2) / cosine
        behind = self.distance - buffer[row * columns + column]
        before: BoolArray = behind <= _DEPTH * self.splats.spacing + _SLACK * slope
        return before

    def _draw(self, buffer: FloatArray, cell: IndexArray, rays: FloatArray, point: IndexArray) -> None:
        """Write the distance at which a cell's ray meets each point's splat, where it is the nearest."""
        ray, normal, local = rays[cell], self.normal[point], self.local[point]
        cosine = np.einsum("nk,nk->n", ray, normal)
        flat = cosine < -_STEEPEST  # comparisons with NaN, off the camera's field, are false
        ray, normal, local, cosine = ray[flat], normal[flat], local[flat], cosine[flat]
        cell, point = cell[flat], point[flat]
        depth = np.einsum("nk,nk->n", normal, local) / cosine
        met = ray * depth[:, None] - local
        first, second = self.first[point], self.second[point]
        x, y = np.einsum("nk,nk->n", met, first), np.einsum("nk,nk->n", met, second)
        along = np.stack([np.einsum("nk,nk->n", ray, first), np.einsum("nk,nk->n", ray, second)], axis=1)
        covered = self.splats.covers(point, x, y, along, cosine)
        np.minimum.at(buffer, cell[covered], depth[covered])


def _cell_rays(camera: Camera, rotation: FloatArray, cell: float, columns: int, rows: int) -> FloatArray:
    """World directions of the cells' centres: (rows * columns,3), NaN outside the camera's field."""
    u, v = np.meshgrid((np.arange(columns) + 0.5) * cell - 0.5, (np.arange(rows) + 0.5) * cell - 0.5)
    return camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1)) @ rotation


def _pixels_per_radian(camera: Camera) -> float:
    """Pixel density in the middle of the frame."""
    middle = np.array([[(camera.width - 1) / 2, (camera.height - 1) / 2]])
    jacobian = camera.project_with_jacobian(camera.unproject(middle))[1][0]
    return float(np.linalg.svd(jacobian, compute_uv=False)[:2].prod() ** 0.5)
