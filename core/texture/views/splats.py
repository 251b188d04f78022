"""The surface a cloud's points stand for: a splat on each point's tangent plane, no larger than it must be.

A splat is the point's Voronoi cell among its neighbours, widened a little so that no holes are left, and cut
where the neighbours end: it does not overhang the rim of a sheet. Its bend tells where a ray that meets the
tangent plane passes the curved surface by. Source: surface splats after Zwicker, Pfister, van Baar and Gross
2001; their shape is explained here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import ArrayLike, BoolArray, Float32Array, FloatArray, IndexArray
from ...jobs import Job, Progress, drain

_NEIGHBOURS = 12
"""Nearest points that bound a splat and tell its bend."""
_SECTORS = 16
"""Directions on the tangent plane in which a splat's extent is kept."""
_WIDENED = 1.55
"""Cells are widened by this factor: neighbouring tangent planes do not meet exactly, nor do sectors."""
_RIM = 0.45
"""Width of the rim (distances to the third neighbour) that is left standing beyond the last neighbours."""
_LARGEST = 2.6
"""Largest extent of a splat in distances to the third neighbour."""
_PORTION = 20_000
"""Points per step of the job."""

_ANGLE = 2 * np.pi * np.arange(_SECTORS) / _SECTORS
_DIRECTION: Float32Array = np.stack([np.cos(_ANGLE), np.sin(_ANGLE)], axis=1).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Splats:
    """One splat per point of a cloud (N,).

    `spacing` (N,) m to the third neighbour; `reach` (N,16) m in as many directions on the tangent plane (see
    `tangents`); `bend` (N,3) 1/m: curvatures along the first tangent, mixed, along the second, positive where
    the surface falls away.
    """

    spacing: Float32Array
    reach: Float32Array
    bend: Float32Array

    def of(self, points: IndexArray | BoolArray) -> Splats:
        """The splats of some points."""
        return Splats(self.spacing[points], self.reach[points], self.bend[points])

    def covers(
        self, point: IndexArray, x: FloatArray, y: FloatArray, ray: FloatArray, cosine: FloatArray
    ) -> BoolArray:
        """Whether rays that meet tangent planes at (x, y) m meet the splats of points (n,) as well.

        `ray` (n,2) are the unit rays' parts along the tangents, `cosine` (n,) those along the normal. With
        curvature k along the ray, the surface lies k s²/2 below the plane at s beyond the point: a ray that
        falls by t per metre meets it when s <= t / 2k.
        """
        sector = np.rint(np.arctan2(y, x) * (_SECTORS / 2 / np.pi)).astype(np.int64) % _SECTORS
        inside = x * x + y * y <= self.reach[point, sector] ** 2
        bend, rx, ry = self.bend[point], ray[:, 0], ray[:, 1]
        curvature = bend[:, 0] * rx * rx + 2 * bend[:, 1] * rx * ry + bend[:, 2] * ry * ry
        met: BoolArray = inside & (2 * curvature * (x * rx + y * ry) <= -cosine * (1 - cosine * cosine))
        return met


def measure_splats(points: ArrayLike, normals: ArrayLike) -> Splats:
    """Run `measure_splats_job` to its end."""
    return drain(measure_splats_job(points, normals))


def measure_splats_job(points: ArrayLike, normals: ArrayLike) -> Job[Splats]:
    """Find the splats of a cloud: (N,3) m, unit normals (N,3) -> Splats, 80 bytes per point."""
    cloud, normal = np.asarray(points, dtype=np.float64), np.asarray(normals, dtype=np.float64)
    local = cloud - cloud[0]
    tree = cKDTree(local)
    count = min(_NEIGHBOURS + 1, len(local))
    found = Splats(
        np.empty(len(local), dtype=np.float32),
        np.empty((len(local), _SECTORS), dtype=np.float32),
        np.empty((len(local), 3), dtype=np.float32),
    )
    for start in range(0, len(local), _PORTION):
        yield Progress(start / len(local), "Measuring the cloud's surface")
        chosen = slice(start, start + _PORTION)
        found_near = tree.query(local[chosen], k=np.arange(1, count + 1))
        distance, near = np.asarray(found_near[0]), np.asarray(found_near[1])
        offset = local[near] - local[chosen, None]
        found.spacing[chosen] = distance[:, min(3, count - 1)]
        flat, height = _on_tangents(offset, normal[chosen])
        found.reach[chosen] = _reach(flat, offset, found.spacing[chosen])
        found.bend[chosen] = _bend(flat, height)
    return found


def tangents(normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors (n,3) on the tangent planes, perpendicular to each other and to the normals (n,3)."""
    helper = np.where(np.abs(normals[:, 2:]) < 0.8, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(helper, normals)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-12)
    return first, np.cross(normals, first)


def _on_tangents(offset: FloatArray, normal: FloatArray) -> tuple[Float32Array, FloatArray]:
    """Offsets (n,k,3) on the tangent planes (n,k,2), and how far they fall away from these (n,k)."""
    flat = np.stack([np.einsum("nkc,nc->nk", offset, axis) for axis in tangents(normal)], axis=-1)
    return flat.astype(np.float32), -np.einsum("nkc,nc->nk", offset, normal)


def _reach(flat: Float32Array, offset: FloatArray, spacing: Float32Array) -> Float32Array:
    """Extent of the splats in all directions: flat (n,k,2), offset (n,k,3), spacing (n,) -> (n,16) m."""
    squared = np.einsum("nkc,nkc->nk", offset, offset).astype(np.float32)
    squared = np.where(squared > 0, squared, np.inf)  # the point itself and its doubles bound nothing
    along = flat @ _DIRECTION.T
    with np.errstate(divide="ignore"):
        cell = (0.5 * _WIDENED * squared[..., None] / np.maximum(along, 0)).min(axis=1)
    support = along.max(axis=1) + _RIM * spacing[:, None]
    cosine = np.maximum(_DIRECTION @ _DIRECTION.T, 1e-3)
    rim = np.stack([(support / row).min(axis=1) for row in cosine], axis=1)
    reach: Float32Array = np.minimum(np.minimum(cell, rim), _LARGEST * spacing[:, None])
    return reach


def _bend(flat: Float32Array, height: FloatArray) -> FloatArray:
    """Least-squares curvatures (n,3) of neighbours that fall away by `height` (n,k); 0 where undetermined."""
    x, y = np.moveaxis(flat.astype(np.float64), -1, 0)
    design = np.stack([0.5 * x * x, x * y, 0.5 * y * y], axis=-1)
    normal = np.einsum("nki,nkj->nij", design, design)
    ridge = 1e-3 * np.einsum("nii->n", normal) + 1e-30
    normal += ridge[:, None, None] * np.eye(3)
    bend: FloatArray = np.linalg.solve(normal, np.einsum("nki,nk->ni", design, height)[..., None])[..., 0]
    return bend
