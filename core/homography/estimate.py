"""A plane's homography between two cameras from one region, without matches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray
from ..cameras.base import Camera
from ..errors import PoseNotFound
from ..geometry.charts import Chart
from ..geometry.moments import boundary_gram, edge_moments
from ..geometry.rigid import rotation_between
from ..pose.regions.contour import lock_ratio, robust_weights
from ..pose.regions.initial import matching_turns, normalised_shape
from ..pose.regions.moment_pair import ORDER as _TURN_ORDER
from ..pose.regions.moment_pair import SMOOTHNESS as _TURN_SMOOTHNESS
from ..regions import ImageRegion
from .views import (
    ORDER,
    RegionView,
    fits_itself,
    moment_count,
    moment_residuals,
    outline_distances,
    overlap_error,
    region_view,
)

OVERLAP_LIMIT = 20.0
"""Overlap error (%) from which two regions do not show the same plane."""

OPEN = (
    "The outlines leave open how their insides lie on each other, as triangles and ovals do: mark a region "
    "with at least four corners, or several planes together."
)

LOCKED = 5.0
"""`lock_ratio` from which outlines coincide: eight parameters make more of chance than a pose's six do."""

NEAR = 0.7
"""Pixels within which outlines coincide."""

_SHARE = 0.15  # of the outlines that coincide then, at least
_SURE = 15.0  # `lock_ratio` beyond which no better place is looked for
_RESTARTS = 6
_SPREAD = 2.0  # how much larger errors of the moments are than white noise on outlines: neighbours err alike

_PLAUSIBLE = 6.0  # times the least cost by moments up to which a map is looked at
_ALIKE = 0.85  # of the largest share of outlines that coincide, from which another map is as good
_UNSURE = 0.1  # of the region's size, from which what lies in it is mapped too unsurely
_CORRELATED = 8.0  # points of an outline whose errors hang together
_FITTED = 4  # maps whose outlines are fitted
_EQUATIONS = moment_count(ORDER)
_ROUGH_ORDER = 3  # the lowest with as many equations as a homography has unknowns
_HOPELESS = 100.0  # times the least cost by them, from which a map is not followed


@dataclass(frozen=True, eq=False)
class Homography:
    """A plane's map between two cameras: `ray2 ~ matrix @ ray1`, matrix (3,3) = `R + t nᵀ / d`.

    `overlap_error` δ in percent (mean of both ways); `transfer_error` px, the standard deviation of a point
    of the region carried to the second photo; `locked`: the outlines were found to coincide. `alternatives`
    are other maps that explain the regions as well; then `ambiguous`, and the one that turns least is taken.
    `rays` (n,3) are directions of the region in the first camera.
    """

    matrix: FloatArray
    overlap_error: float
    transfer_error: float
    locked: bool
    alternatives: tuple[FloatArray, ...]
    rays: FloatArray

    @property
    def ambiguous(self) -> bool:
        """Whether the regions alone cannot decide."""
        return bool(self.alternatives)


@dataclass(frozen=True, eq=False)
class _Fit:
    """A map, its cost by moments, overlap error (%), covariance (8,8), share of outlines that coincide."""

    matrix: FloatArray
    cost: float
    overlap: float
    covariance: FloatArray
    share: float = 0.0


@dataclass(frozen=True, eq=False)
class _Coincidence:
    """A map near which outlines coincide: how clearly (`lock_ratio`), and which share of them."""

    matrix: FloatArray
    ratio: float
    share: float


@dataclass(frozen=True, eq=False)
class _Both:
    """A region in two photos, and the coordinates in which the map is well conditioned."""

    first: RegionView
    second: RegionView
    from_first: FloatArray
    to_second: FloatArray

    def matrix(self, inner: FloatArray) -> FloatArray:
        """Map of rays from a map (3,3) of the charts' coordinates, of positive determinant."""
        matrix: FloatArray = np.linalg.solve(self.to_second, inner @ self.from_first)
        matrix *= np.sign(np.linalg.det(matrix)) / np.linalg.norm(matrix)
        return matrix

    def directions(self, matrix: FloatArray) -> FloatArray:
        """The eight ways (8,3,3) in which a map can change."""
        inner = self.to_second @ matrix @ np.linalg.inv(self.from_first)
        others = np.linalg.svd(inner.reshape(1, 9))[2][1:].reshape(8, 3, 3) * np.linalg.norm(inner)
        ways: FloatArray = np.linalg.solve(self.to_second, others @ self.from_first)
        return ways

    def carried(
        self, matrix: FloatArray
    ) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
        """Rays of either outline in the other camera and their derivatives: (n,3), (n,3,8) both ways."""
        ways = self.directions(matrix)
        inverse = np.linalg.inv(matrix)
        there, back = self.first.rays @ matrix.T, self.second.rays @ inverse.T
        there_rates = np.einsum("pij,nj->nip", ways, self.first.rays)
        back_rates = -np.einsum("pij,nj->nip", inverse @ ways, back)
        return (there, there_rates), (back, back_rates)


def estimate_homography(
    camera1: Camera, camera2: Camera, image_region1: ImageRegion, image_region2: ImageRegion
) -> Homography:
    """Homography of the plane on which one region lies that both photos show whole.

    Raises
    ------
    RegionError
        A region that cannot be used: cut off by the frame, too small, of another size than its photo.
    PoseNotFound
        No plane explains both outlines, or too many do: a triangle or an oval fits itself in many ways.

    Source: method.md 5, Alg. 5, by boundary integrals in a chart per region with whitened moments; then the
    outlines themselves, robustly.
    """
    first, second = region_view(camera1, image_region1), region_view(camera2, image_region2)
    if fits_itself(first) or fits_itself(second):
        raise PoseNotFound(OPEN)
    both = _Both(first, second, _flattening(first.chart), _flattening(second.chart))
    rng = np.random.default_rng(0)
    found = _moment_fits(both)
    fits = [_by_outlines(both, fit, rng) for fit in _plausible(found)] if found else []
    fits = [fit for fit in fits if fit.overlap <= OVERLAP_LIMIT]
    if not fits:
        raise PoseNotFound(
            "No plane explains both outlines: check that the regions show the same flat thing, and all of it."
        )
    chosen, others = _chosen(both, fits)
    error = _transfer_error(both, chosen)
    if not error < _UNSURE * second.size:
        raise PoseNotFound(OPEN)
    return Homography(
        unit_scale(chosen.matrix), chosen.overlap, error, chosen.share > 0,
        tuple(unit_scale(fit.matrix) for fit in others), first.rays,
    )  # fmt: skip


def rough_homographies(first: RegionView, second: RegionView) -> list[FloatArray]:
    """Homographies (3,3) that explain the moments of a region in two photos, best first."""
    both = _Both(first, second, _flattening(first.chart), _flattening(second.chart))
    fits = _moment_fits(both)
    return [fit.matrix for fit in _plausible(fits) if fit.overlap < OVERLAP_LIMIT] if fits else []


def _moment_fits(both: _Both) -> list[_Fit]:
    """Distinct maps by moments from all starts, best first; low orders tell which are worth the high ones."""
    rough = [_descended(both, matrix, _ROUGH_ORDER, 10)[:2] for matrix in _starts(both)]
    least = min(cost for _, cost in rough)
    fits = [_by_moments(both, matrix) for matrix, cost in rough if cost <= _HOPELESS * least]
    return _unlike(sorted((fit for fit in fits if np.isfinite(fit.cost)), key=lambda fit: fit.cost))


def unit_scale(matrix: FloatArray) -> FloatArray:
    """Homography scaled to `R + t nᵀ / d`: its middle singular value is 1, its determinant positive."""
    scaled: FloatArray = matrix * np.sign(np.linalg.det(matrix)) / np.linalg.svd(matrix, compute_uv=False)[1]
    return scaled


def _flattening(chart: Chart) -> FloatArray:
    """Matrix (3,3) from rays to the chart's homogeneous coordinates, as if it were gnomonic."""
    s, (x, y) = chart.scale, chart.offset
    flat: FloatArray = np.array([[s, 0, -s * x], [0, s, -s * y], [0, 0, 1.0]]) @ chart.rotation
    return flat


def _starts(both: _Both) -> list[FloatArray]:
    """Affine maps that bring the outlines' first and second moments together, turned as the others tell."""
    (map1, mean1), shape1 = normalised_shape(_plane_edges(both.first))
    (map2, mean2), shape2 = normalised_shape(_plane_edges(both.second))
    whitening = np.linalg.inv(np.linalg.cholesky(boundary_gram(*shape2, _TURN_ORDER, _TURN_SMOOTHNESS)))
    turned, target = edge_moments(*shape1, _TURN_ORDER), edge_moments(*shape2, _TURN_ORDER)
    starts = []
    for angle in matching_turns(turned, target, whitening):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        linear = np.linalg.inv(map2) @ turn @ map1
        inner = np.eye(3)
        inner[:2, :2], inner[:2, 2] = linear, mean2 - linear @ mean1
        starts.append(both.matrix(inner))
    return starts


def _plane_edges(view: RegionView) -> tuple[FloatArray, FloatArray]:
    """The outline in gnomonic coordinates; what lies sideways of a wide region is drawn near."""
    local = view.rays @ _flattening(view.chart).T
    flat = local[:, :2] / np.maximum(local[:, 2:], 0.1)
    return flat, flat[view.following]


def _by_moments(both: _Both, matrix: FloatArray) -> _Fit:
    """Levenberg-Marquardt on the moments of both directions."""
    matrix, cost, normal = _descended(both, matrix, ORDER, 25)
    if not np.isfinite(cost):
        return _Fit(matrix, np.inf, 100.0, np.zeros((8, 8)))
    spread = cost / (2 * _EQUATIONS - 8)
    return _Fit(matrix, cost, _overlap(both, matrix), _SPREAD**2 * spread * inverse(normal))


def _descended(
    both: _Both, matrix: FloatArray, order: int, rounds: int
) -> tuple[FloatArray, float, FloatArray]:
    """Map, cost and normal matrix (8,8) where the moments agree best."""
    normal, gradient, cost = _moment_equations(both, matrix, order)
    damping = 1e-3
    for _ in range(rounds):
        if not np.isfinite(cost) or damping > 1e6:
            break
        step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)) + 1e-12 * np.eye(8), gradient)
        moved = _stepped(both, matrix, step)
        found = _moment_equations(both, moved, order)
        if found[2] < cost:
            small = cost - found[2] < 1e-9 * cost
            matrix, (normal, gradient, cost), damping = moved, found, damping * 0.1
            if small:
                break
        else:
            damping *= 10
    return matrix, cost, normal


def _stepped(both: _Both, matrix: FloatArray, step: FloatArray) -> FloatArray:
    moved: FloatArray = matrix + np.einsum("p,pij->ij", step, both.directions(matrix))
    return moved / np.linalg.norm(moved)


def _moment_equations(both: _Both, matrix: FloatArray, order: int) -> tuple[FloatArray, FloatArray, float]:
    """`JᵀJ` (8,8), `Jᵀr` (8,) and the cost, infinite where the region would lie behind a camera."""
    if not np.linalg.det(matrix) > 0:
        return np.eye(8), np.zeros(8), np.inf
    (there, there_rates), (back, back_rates) = both.carried(matrix)
    found = (
        moment_residuals(both.second, there, there_rates, both.first.following, order),
        moment_residuals(both.first, back, back_rates, both.second.following, order),
    )
    residual = np.concatenate([part[0] for part in found])
    jacobian = np.concatenate([part[1] for part in found])
    if not np.all(np.isfinite(residual)) or not np.all(np.isfinite(jacobian)):
        return np.eye(8), np.zeros(8), np.inf
    return jacobian.T @ jacobian, jacobian.T @ residual, float(residual @ residual)


def _by_outlines(both: _Both, fit: _Fit, rng: np.random.Generator) -> _Fit:
    """The map moved until the outlines coincide, if they do; otherwise as it was.

    Where few do, it starts again from maps that the moments leave as likely.
    """
    best = _coinciding(both, fit.matrix, float(np.clip(0.02 * fit.overlap * both.second.size, 3.0, 40.0)))
    spread = np.linalg.cholesky(fit.covariance + 1e-14 * np.trace(fit.covariance) * np.eye(8))
    for _ in range(_RESTARTS):
        if best.ratio > _SURE:
            break
        start = _stepped(both, fit.matrix, spread @ rng.standard_normal(8))
        found = _coinciding(both, start, 6.0)
        best = max(best, found, key=lambda match: match.share)
    if best.ratio < LOCKED or best.share < _SHARE:
        return fit
    covariance = outline_covariance(*_distances(both, best.matrix))
    return _Fit(best.matrix, fit.cost, _overlap(both, best.matrix), covariance, best.share)


def _coinciding(both: _Both, matrix: FloatArray, scale: float) -> _Coincidence:
    """Where the outlines coincide best near a map, looked for within `scale` px at first."""
    while scale > 1.0:
        for _ in range(2):
            matrix = _stepped(both, matrix, outline_step(*_distances(both, matrix), scale))
        scale *= 0.75
    for _ in range(4):
        matrix = _stepped(both, matrix, outline_step(*_distances(both, matrix), 1.0))
    distances = _distances(both, matrix)[0]
    share = float(np.count_nonzero(np.abs(np.nan_to_num(distances, nan=np.inf)) < NEAR)) / len(distances)
    return _Coincidence(matrix, lock_ratio(distances[np.isfinite(distances)], NEAR), share)


def outline_step(distances: FloatArray, jacobian: FloatArray, scale: float) -> FloatArray:
    """Gauss-Newton step (P,) that lessens distances (n,) px, with Geman-McClure weights at `scale` px."""
    weighted = jacobian * robust_weights(distances, scale)[:, None]
    normal = weighted.T @ jacobian
    least = 1e-12 * np.trace(normal) + 1e-300  # where nothing is seen there is no step
    damped = normal + 1e-6 * np.diag(np.diag(normal)) + least * np.eye(len(normal))
    step: FloatArray = -np.linalg.solve(damped, weighted.T @ np.nan_to_num(distances))
    return step


def outline_covariance(distances: FloatArray, jacobian: FloatArray) -> FloatArray:
    """Covariance (P,P) of parameters fitted to distances (n,) px of which neighbours err alike."""
    weights = robust_weights(distances, 1.0)
    variance = np.sum(weights * np.nan_to_num(distances) ** 2) / max(np.sum(weights), 1.0)
    normal = (jacobian * weights[:, None]).T @ jacobian
    covariance: FloatArray = max(variance, 0.1**2) * _CORRELATED * inverse(normal)
    return covariance


def inverse(normal: FloatArray) -> FloatArray:
    """Inverse (P,P) of a normal matrix; directions it says nothing about get a very large variance."""
    values, vectors = np.linalg.eigh(normal)
    inverted: FloatArray = vectors @ np.diag(1.0 / np.maximum(values, 1e-14 * values[-1])) @ vectors.T
    return inverted


def _distances(both: _Both, matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distances (n,) px of the outlines in both photos and their derivatives (n,8)."""
    (there, there_rates), (back, back_rates) = both.carried(matrix)
    found = (
        outline_distances(both.second, there, there_rates, both.first.following),
        outline_distances(both.first, back, back_rates, both.second.following),
    )
    return np.concatenate([part[0] for part in found]), np.concatenate([part[1] for part in found])


def _overlap(both: _Both, matrix: FloatArray) -> float:
    """Overlap error δ in percent, mean of both ways."""
    there = overlap_error(both.second, both.first.rays @ matrix.T, both.first.following)
    back = overlap_error(both.first, both.second.rays @ np.linalg.inv(matrix).T, both.second.following)
    return 0.5 * (there + back)


def _unlike(fits: Sequence[_Fit]) -> list[_Fit]:
    """Fits of which none is the same as one before."""
    kept: list[_Fit] = []
    for fit in fits:
        if all(np.linalg.norm(fit.matrix - other.matrix) > 1e-3 for other in kept):
            kept.append(fit)
    return kept


def _plausible(fits: Sequence[_Fit]) -> list[_Fit]:
    """The fits, sorted by cost, that explain the moments about as well as the best."""
    return [fit for fit in fits if fit.cost <= _PLAUSIBLE * fits[0].cost][:_FITTED]


def _chosen(both: _Both, fits: Sequence[_Fit]) -> tuple[_Fit, list[_Fit]]:
    """The fit to take and those that explain the regions as well; of these the least turned one is taken."""
    most = max(fit.share for fit in fits)
    equal = _unlike([fit for fit in fits if fit.share >= _ALIKE * most])
    equal.sort(key=lambda fit: _turn(both, fit.matrix))
    return equal[0], equal[1:]


def _turn(both: _Both, matrix: FloatArray) -> float:
    """Angle (rad) by which a map turns the region, beyond what brings its middle to where it is."""
    straight = rotation_between(both.first.middle, both.second.middle)
    mapped = both.first.rays @ matrix.T
    mapped /= np.linalg.norm(mapped, axis=1, keepdims=True)
    expected = both.first.rays @ straight.T
    axis = both.second.middle
    a, b = expected - np.outer(expected @ axis, axis), mapped - np.outer(mapped @ axis, axis)
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    return abs(float(np.arctan2(np.sum(np.cross(a, b) @ axis), np.sum(a * b))))


def _transfer_error(both: _Both, fit: _Fit) -> float:
    """Standard deviation (px) of points between the region's middle and its outline, in the second photo."""
    inside = np.concatenate([both.first.middle[None], 0.5 * (both.first.middle + both.first.rays[::10])])
    ways = both.directions(fit.matrix)
    slope = both.second.camera.project_with_jacobian(inside @ fit.matrix.T)[1]
    rates = np.einsum("nij,pjk,nk->nip", slope, ways, inside)
    variance = np.einsum("nip,pq,niq->n", rates, fit.covariance, rates)
    return float(np.sqrt(np.nanmean(variance)))
