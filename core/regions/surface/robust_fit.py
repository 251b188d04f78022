"""Planes and quadrics through points of which many do not belong.

Minimum covariance determinant and reweighting.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray, IndexArray

_STARTS = 12  # random subsets of the minimum covariance determinant
_STEPS = 6  # concentration steps per start


@dataclass(frozen=True, eq=False)
class SurfaceFit:
    """A plane, or a graph of second order over it.

    `centre` (3,) m, `axes` (3,3) unit rows, the third the normal; `bend` (6,) are the coefficients of
    1, x, y, xx, xy, yy in the frame (all zero: a plane); `sigma` m is the robust deviation
    of the points from it.
    """

    centre: FloatArray
    axes: FloatArray
    bend: FloatArray
    sigma: float

    @property
    def normal(self) -> FloatArray:
        """Unit normal (3,) of the plane."""
        normal: FloatArray = self.axes[2]
        return normal

    @property
    def curved(self) -> bool:
        """Whether the fit is of second order."""
        return bool(np.any(self.bend != 0))

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distances (N,) m of points (N,3), along the plane's normal."""
        local = (points - self.centre) @ self.axes.T
        distance: FloatArray = local[:, 2] - _second_order(local[:, :2]) @ self.bend
        return distance

    def normals(self, points: FloatArray) -> FloatArray:
        """Unit normals (N,3) of the fit below points (N,3)."""
        if not self.curved:
            return np.broadcast_to(self.normal, (len(points), 3))
        x, y = ((points - self.centre) @ self.axes[:2].T).T
        slope_x = self.bend[1] + 2 * self.bend[3] * x + self.bend[4] * y
        slope_y = self.bend[2] + self.bend[4] * x + 2 * self.bend[5] * y
        normals: FloatArray = np.stack([-slope_x, -slope_y, np.ones(len(points))], axis=1) @ self.axes
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return normals


def plane_through(point: FloatArray, normal: FloatArray) -> SurfaceFit:
    """Plane through a point (3,) with a unit normal (3,)."""
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= max(float(np.linalg.norm(across)), 1e-300)
    return SurfaceFit(point, np.stack([across, np.cross(normal, across), normal]), np.zeros(6), 0.0)


def fit_plane(points: FloatArray, share: float = 0.6, starts: int = _STARTS, seed: int = 0) -> SurfaceFit:
    """Plane through the `share` of points (N,3) that lies closest to one plane.

    Source: minimum covariance determinant, Rousseeuw and Van Driessen, A fast algorithm for the minimum
    covariance determinant estimator, 1999; method.md 6. The random starts are seeded: the same points, the
    same plane.
    """
    rng = np.random.default_rng(seed)
    count = min(max(4, int(share * len(points))), len(points))
    origin = points.mean(axis=0)
    local = points - origin
    best = _concentrated(local, np.arange(len(local)), count)
    for _ in range(starts if len(points) > 8 else 0):
        start = rng.choice(len(local), 4, replace=False)
        found = _concentrated(local, start, count)
        if found[2] < best[2]:
            best = found
    centre, axes, _ = best
    distance = (local - centre) @ axes[2]
    sigma = 1.4826 * float(np.median(np.abs(distance)))
    return SurfaceFit(centre + origin, axes, np.zeros(6), sigma)


def _concentrated(points: FloatArray, start: IndexArray, count: int) -> tuple[FloatArray, FloatArray, float]:
    """Centre, axes and objective after concentration steps.

    The points nearest to the plane make the next plane.

    The objective is the smallest eigenvalue: across the plane the scatter shall be least, along it it may
    be wide.
    """
    chosen = start
    centre, axes, objective = np.zeros(3), np.eye(3), np.inf
    for _ in range(_STEPS):
        some = points[chosen]
        centre = some.mean(axis=0)
        off = some - centre
        values, vectors = np.linalg.eigh(off.T @ off / len(some))
        if len(some) == count and values[0] > 0.999 * objective:
            break  # with as many points as before the objective never rises: it has come to rest
        axes = vectors.T[::-1].copy()
        axes[1] = np.cross(axes[2], axes[0])
        objective = float(values[0]) if len(some) == count else np.inf
        distance = np.abs((points - centre) @ axes[2])
        chosen = np.argpartition(distance, count - 1)[:count]
    return centre, axes, objective


def fit_quadric(points: FloatArray, plane: SurfaceFit) -> SurfaceFit:
    """Graph of second order over a plane through points (N,3), outliers reweighted (Geman-McClure)."""
    local = (points - plane.centre) @ plane.axes.T
    scale = max(float(np.abs(local[:, :2]).max()), 1e-12)
    design = _second_order(local[:, :2] / scale)
    weight = np.ones(len(points))
    bend = np.zeros(6)
    for _ in range(8):
        gram = design.T * weight @ design + 1e-9 * len(points) * np.eye(6)
        bend = np.linalg.solve(gram, design.T @ (weight * local[:, 2]))
        misfit = local[:, 2] - design @ bend
        deviation = max(1.4826 * float(np.median(np.abs(misfit))), 1e-12)
        weight = 1.0 / (1.0 + (misfit / (2 * deviation)) ** 2) ** 2
    sigma = 1.4826 * float(np.median(np.abs(local[:, 2] - design @ bend)))
    unit = np.array([1, scale, scale, scale**2, scale**2, scale**2])
    return SurfaceFit(plane.centre, plane.axes, bend / unit, sigma)


def fit_smooth(points: FloatArray, starts: int = _STARTS) -> SurfaceFit:
    """Plane, or a graph of second order where that explains the points clearly better (scatter less by 40 %).

    Points that were chosen near an earlier fit need no random `starts`.
    """
    plane = fit_plane(points, starts=starts)
    if len(points) < 40:
        return plane
    quadric = fit_quadric(points, plane)
    return quadric if quadric.sigma < 0.6 * plane.sigma else plane


def _second_order(xy: FloatArray) -> FloatArray:
    x, y = xy[:, 0], xy[:, 1]
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
