"""Which points of a cloud a photo sees: by a depth buffer of oriented discs, or by Hidden Point Removal."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from ..arrays import ArrayLike, BoolArray, FloatArray, IndexArray
from ..cameras.base import Camera
from ..errors import TextureError
from ..photos.view import View
from .visibility import project

_DISC = 1.3
"""Radius of a point's disc over the distance to its third neighbour: larger ones leave fewer holes, but hide
more of what lies beside an edge."""
_CELLS_PER_DISC = 2.0
_WIDEST_SPLAT = 4
"""Half-width in cells up to which a disc is drawn; nearer discs would cover more of the picture."""
_STEEPEST = 0.05
"""Discs seen at a smaller cosine hide nothing: they are thin lines in the picture."""

Method = Literal["depth", "hull"]


def visible_points(
    points: ArrayLike,
    normals: ArrayLike | None,
    view: View,
    method: Method = "depth",
    gamma: float = 3.0,
    spacing: float | None = None,
) -> BoolArray:
    """Whether a photo sees each point of a cloud: (N,3) m, unit normals (N,3) or None, -> (N,).

    "depth" needs normals: every point is a disc that covers its neighbourhood; points behind discs are hidden
    and so are those that look away. "hull" is Katz's Hidden Point Removal, which needs none, with a flipping
    radius of `10 ** gamma` times the farthest point; with normals those that look away are hidden too.
    `spacing` (m) between neighbours is measured when not given. Raises TextureError.
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
        kept = _in_depth_buffer(local, normal, view, spacing or point_spacing(cloud))
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


def _in_depth_buffer(local: FloatArray, normal: FloatArray, view: View, spacing: float) -> BoolArray:
    """Visibility of points (n,3), relative to the camera's centre, among each other.

    Discs much nearer than the others are drawn into pictures of larger cells: so none is left with holes.
    """
    distance = np.linalg.norm(local, axis=1)
    density = _pixels_per_radian(view.camera)
    # Discs are drawn about two cells wide at the median distance.
    finest = max(1.0, density * spacing * _DISC / float(np.median(distance)) / _CELLS_PER_DISC)
    reach = density * spacing * _DISC / distance / finest
    level = np.ceil(np.log2(np.maximum(reach / _WIDEST_SPLAT, 1.0))).astype(np.int64)
    pixel = view.camera.project(local @ np.asarray(view.rotation, dtype=np.float64).T)
    visible = np.ones(len(local), dtype=np.bool_)
    for number in np.unique(level):
        drawn = np.flatnonzero(level == number)
        visible &= _in_front_of(local, normal, pixel, drawn, view, spacing, finest * 2.0**number)
    return visible


def _in_front_of(
    local: FloatArray,
    normal: FloatArray,
    pixel: FloatArray,
    drawn: IndexArray,
    view: View,
    spacing: float,
    cell: float,
) -> BoolArray:
    """Whether points (n,3) lie before the discs of those `drawn` into a picture with cells of `cell` px."""
    distance = np.linalg.norm(local, axis=1)
    density = _pixels_per_radian(view.camera)
    columns, rows = int(view.camera.width / cell) + 1, int(view.camera.height / cell) + 1
    column = np.clip((pixel[:, 0] + 0.5) / cell, 0, columns - 1).astype(np.int64)
    row = np.clip((pixel[:, 1] + 0.5) / cell, 0, rows - 1).astype(np.int64)
    rays = _cell_rays(view.camera, np.asarray(view.rotation, dtype=np.float64), cell, columns, rows)
    buffer = np.full(columns * rows, np.inf)
    reach = np.ceil(density * spacing * _DISC / distance[drawn] / cell).astype(np.int64)
    plane = np.einsum("nk,nk->n", normal, local)
    for dv in range(-_WIDEST_SPLAT, _WIDEST_SPLAT + 1):
        for du in range(-_WIDEST_SPLAT, _WIDEST_SPLAT + 1):
            u, v = column[drawn] + du, row[drawn] + dv
            inside = (
                (np.maximum(abs(du), abs(dv)) <= reach) & (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
            )
            here = drawn[inside]
            at = (v * columns + u)[inside]
            _draw(buffer, at, rays, local[here], normal[here], plane[here], spacing)
    cosine = np.maximum(-plane / distance, _STEEPEST)
    # A cell's ray passes the point at up to half a cell; on a slope its depth differs by as much.
    slope = distance * (cell / density) * np.sqrt(1 - cosine**2) / cosine
    before: BoolArray = distance <= buffer[row * columns + column] + spacing + 0.75 * slope
    return before


def _draw(
    buffer: FloatArray,
    cell: IndexArray,
    rays: FloatArray,
    local: FloatArray,
    normal: FloatArray,
    plane: FloatArray,
    spacing: float,
) -> None:
    """Write the distance at which a cell's ray meets each point's disc, where it is the nearest."""
    ray = rays[cell]
    cosine = np.einsum("nk,nk->n", ray, normal)
    flat = cosine < -_STEEPEST
    depth = plane / np.where(flat, cosine, -1.0)
    off = np.linalg.norm(ray * depth[:, None] - local, axis=1)
    met = flat & (off <= _DISC * spacing)  # comparisons with NaN, off the camera's field, are false
    np.minimum.at(buffer, cell[met], depth[met])


def _cell_rays(camera: Camera, rotation: FloatArray, cell: float, columns: int, rows: int) -> FloatArray:
    """World directions of the cells' centres: (rows * columns,3), NaN outside the camera's field."""
    u, v = np.meshgrid((np.arange(columns) + 0.5) * cell - 0.5, (np.arange(rows) + 0.5) * cell - 0.5)
    return camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1)) @ rotation


def _pixels_per_radian(camera: Camera) -> float:
    """Pixel density in the middle of the frame."""
    middle = np.array([[(camera.width - 1) / 2, (camera.height - 1) / 2]])
    jacobian = camera.project_with_jacobian(camera.unproject(middle))[1][0]
    return float(np.linalg.svd(jacobian, compute_uv=False)[:2].prod() ** 0.5)
