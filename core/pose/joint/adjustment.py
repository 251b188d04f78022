"""Least squares over all poses and all tracked points, with the points drawn to the scan.

The points are eliminated (Schur complement), so that the system to solve has six unknowns per photo.
Source: Triggs et al. 2000, "Bundle adjustment — a modern synthesis"; the scan enters as one point-to-plane
equation per track.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import bsr_matrix, csr_matrix

from ...arrays import BoolArray, FloatArray, IndexArray
from ...geometry.rigid import exp_so3, log_so3
from ...jobs import Job, Progress, drain
from ..points.perturbation import camera_point_jacobian, invert_scaled
from ..points.sightings import reprojection
from .tracks import Tracks

LOSS = 2.5
"""Width of the Cauchy loss in standard deviations."""


@dataclass(frozen=True, eq=False)
class Network:
    """Photos and tracks to adjust: rotations (N,3,3), centres (N,3) m, points (T,3) m."""

    rotations: FloatArray
    centres: FloatArray
    points: FloatArray

    def moved(self, cameras: FloatArray, points: FloatArray) -> Network:
        """Apply steps of the cameras (N,6) and the points (T,3)."""
        return Network(
            exp_so3(cameras[:, :3]) @ self.rotations, self.centres + cameras[:, 3:], self.points + points
        )


@dataclass(frozen=True, eq=False)
class ScanTies:
    """Where the scan lies next to each track: `feet` (T,3), unit `normals` (T,3), NaN where there is none.

    `share` (T,) in (0, 1]: how much the tie counts; errors of a scan are alike over a patch.
    """

    feet: FloatArray
    normals: FloatArray
    share: FloatArray


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of the poses beforehand: rotations (N,3,3), centres (N,3), information (N,6,6)."""

    rotations: FloatArray
    centres: FloatArray
    information: FloatArray


@dataclass(frozen=True)
class Noise:
    """Standard deviations: `pixel` of the smallest features (px), `scan` of the surface (m)."""

    pixel: float
    scan: float


@dataclass(frozen=True, eq=False)
class _System:
    """Normal equations by blocks: of cameras (N,6,6), points (T,3,3), mixed ones per sighting (M,6,3)."""

    camera: FloatArray
    point: FloatArray
    mixed: FloatArray
    camera_gradient: FloatArray
    point_gradient: FloatArray
    cost: float


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything that stays while the network moves."""

    tracks: Tracks
    ties: ScanTies
    prior: Prior
    noise: Noise

    def residuals(self, network: Network) -> tuple[FloatArray, FloatArray]:
        """Whitened lengths: of the sightings (M,) and of the scan ties (T,), 0 without a tie."""
        tracks = self.tracks
        in_camera = _in_camera(network, tracks)
        pixel = reprojection(tracks.rays, tracks.to_pixels, in_camera)[0]
        sight = np.linalg.norm(pixel, axis=1) / (self.noise.pixel * tracks.size)
        return sight, np.abs(self._scan_residuals(network))

    def _scan_residuals(self, network: Network) -> FloatArray:
        away = np.einsum("tk,tk->t", network.points - self.ties.feet, self.ties.normals)
        out: FloatArray = np.nan_to_num(away) / self.noise.scan
        return out

    def linearise(self, network: Network) -> _System:
        """Normal equations at a network, robustly weighted."""
        tracks, count = self.tracks, len(network.centres)
        in_camera = _in_camera(network, tracks)
        pixel, by_point = reprojection(tracks.rays, tracks.to_pixels, in_camera)
        white = 1.0 / (self.noise.pixel * tracks.size)
        squared = np.einsum("mi,mi->m", pixel, pixel) * white**2
        cost, weight = _robust(squared)
        weight = weight * white**2
        rotations = network.rotations[tracks.view]
        by_camera = by_point @ _camera_jacobians(rotations, in_camera)
        by_world = by_point @ rotations
        weighted = by_camera * weight[:, None, None]
        weighted_world = by_world * weight[:, None, None]
        to_view = _summing(tracks.view, count)
        to_track = _summing(tracks.track, tracks.count)
        scan_cost, point, point_gradient = self._scan_system(network)
        prior_cost, camera, camera_gradient = self._prior_system(network)
        return _System(
            camera + _sum(to_view, np.einsum("mia,mib->mab", weighted, by_camera)),
            point + _sum(to_track, np.einsum("mia,mib->mab", weighted_world, by_world)),
            np.einsum("mia,mib->mab", weighted, by_world),
            camera_gradient + _sum(to_view, np.einsum("mia,mi->ma", weighted, pixel)),
            point_gradient + _sum(to_track, np.einsum("mia,mi->ma", weighted_world, pixel)),
            float(cost.sum()) + scan_cost + prior_cost,
        )

    def _scan_system(self, network: Network) -> tuple[float, FloatArray, FloatArray]:
        residual = self._scan_residuals(network)
        cost, weight = _robust(residual**2)
        normal = np.nan_to_num(self.ties.normals) / self.noise.scan
        weight = weight * self.ties.share
        block = np.einsum("t,ta,tb->tab", weight, normal, normal)
        return float((cost * self.ties.share).sum()), block, (weight * residual)[:, None] * normal

    def _prior_system(self, network: Network) -> tuple[float, FloatArray, FloatArray]:
        turned = log_so3(network.rotations @ np.swapaxes(self.prior.rotations, 1, 2))
        step = np.concatenate([turned, network.centres - self.prior.centres], axis=1)
        pulled = np.einsum("nab,nb->na", self.prior.information, step)
        cost, weight = _robust(np.einsum("na,na->n", step, pulled) / 6.0)
        information = self.prior.information * weight[:, None, None]
        return 6.0 * float(cost.sum()), information, pulled * weight[:, None]


def adjust(problem: Problem, network: Network, iterations: int = 25) -> Network:
    """Levenberg–Marquardt over all photos and points."""
    return drain(adjust_job(problem, network, iterations))


def adjust_job(problem: Problem, network: Network, iterations: int = 25) -> Job[Network]:
    """Job of `adjust`: one step per iteration."""
    system = problem.linearise(network)
    damping = 1e-4
    for number in range(iterations):
        yield Progress(number / iterations, f"Adjusting {problem.tracks.count} points")
        trial = network.moved(*_step(problem, system, damping))
        trial_system = problem.linearise(trial)
        if trial_system.cost >= system.cost:
            damping *= 10
            if damping > 1e6:
                break
            continue
        gain = system.cost - trial_system.cost
        network, system, damping = trial, trial_system, max(damping * 0.1, 1e-9)
        if gain < 1e-6 * system.cost:
            break
    return network


def covariances(problem: Problem, network: Network) -> FloatArray:
    """Covariance (N,6,6) of every pose, all others and the points free."""
    system = problem.linearise(network)
    reduced, _, _ = _reduce(problem, system, 0.0)
    full = invert_scaled(reduced)
    count = len(network.centres)
    blocks: FloatArray = full.reshape(count, 6, count, 6)[np.arange(count), :, np.arange(count)]
    return blocks


def estimate_noise(problem: Problem, network: Network) -> Noise:
    """Standard deviations that the residuals speak of. Source: variance components, Helmert 1907.

    What a group of equations spends on the unknowns is taken from its freedom, track by track.
    """
    system = problem.linearise(network)
    sight, scan = problem.residuals(network)
    spent = _spent_on_scan(problem, system)
    tied = np.isfinite(problem.ties.normals[:, 0])
    # equations minus unknowns: two per sighting, three unknowns per point, shared with the scan's equation
    sight_freedom = 2.0 * len(sight) - float((3.0 - spent)[tied].sum()) - 3.0 * float((~tied).sum())
    pixel = problem.noise.pixel * np.sqrt(float((sight**2).sum()) / max(sight_freedom, 1.0))
    normal_scan = scan[tied] / np.sqrt(np.maximum(1.0 - spent[tied], 0.05))
    scan_sigma = (
        problem.noise.scan * 1.483 * float(np.median(normal_scan)) if tied.any() else problem.noise.scan
    )
    return Noise(float(np.clip(pixel, 0.05, 5.0)), float(np.clip(scan_sigma, 1e-4, 0.2)))


def _spent_on_scan(problem: Problem, system: _System) -> FloatArray:
    """Share (T,) of each scan equation that goes into its point."""
    inverse = np.linalg.inv(system.point + 1e-9 * np.eye(3))
    normal = np.nan_to_num(problem.ties.normals) / problem.noise.scan
    share = problem.ties.share * np.einsum("ta,tab,tb->t", normal, inverse, normal)
    spent: FloatArray = np.clip(share, 0.0, 1.0)
    return spent


def without_outliers(problem: Problem, network: Network, limit: float) -> tuple[Problem, Network]:
    """Drop sightings and tracks with whitened residuals beyond `limit`."""
    sight, scan = problem.residuals(network)
    in_front = np.einsum("mk,mk->m", _in_camera(network, problem.tracks), problem.tracks.rays) > 0
    kept = (sight < limit) & in_front & (scan < limit)[problem.tracks.track]
    return _selected(problem, network, kept)


def _selected(problem: Problem, network: Network, kept: BoolArray) -> tuple[Problem, Network]:
    tracks = problem.tracks.select(kept)
    seen = np.bincount(problem.tracks.track[kept], minlength=problem.tracks.count) >= 2
    ties = ScanTies(problem.ties.feet[seen], problem.ties.normals[seen], problem.ties.share[seen])
    return replace(problem, tracks=tracks, ties=ties), replace(network, points=network.points[seen])


def _in_camera(network: Network, tracks: Tracks) -> FloatArray:
    away = network.points[tracks.track] - network.centres[tracks.view]
    out: FloatArray = np.einsum("mij,mj->mi", network.rotations[tracks.view], away)
    return out


def _camera_jacobians(rotations: FloatArray, in_camera: FloatArray) -> FloatArray:
    out = camera_point_jacobian(np.eye(3), in_camera)
    out[:, :, 3:] = -rotations
    return out


def _robust(squared: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cauchy loss of squared whitened residuals: values and weights."""
    return LOSS**2 * np.log1p(squared / LOSS**2), 1.0 / (1.0 + squared / LOSS**2)


def _summing(index: IndexArray, count: int) -> csr_matrix:
    """Matrix (count, M) that adds up the rows that belong to the same index."""
    return csr_matrix((np.ones(len(index)), (index, np.arange(len(index)))), shape=(count, len(index)))


def _sum(summing: csr_matrix, values: FloatArray) -> FloatArray:
    flat = summing @ values.reshape(len(values), -1)
    out: FloatArray = flat.reshape(summing.shape[0], *values.shape[1:])
    return out


def _step(problem: Problem, system: _System, damping: float) -> tuple[FloatArray, FloatArray]:
    """Damped Gauss-Newton step of the cameras (N,6) and the points (T,3)."""
    reduced, gradient, inverse = _reduce(problem, system, damping)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(reduced), 1e-300))
    scaled = reduced * np.outer(scale, scale)
    cameras = -(scale * np.linalg.solve(scaled, scale * gradient)).reshape(-1, 6)
    tracks = problem.tracks
    coupled = np.einsum("mab,ma->mb", system.mixed, cameras[tracks.view])
    back = system.point_gradient + _sum(_summing(tracks.track, tracks.count), coupled)
    return cameras, -np.einsum("tab,tb->ta", inverse, back)


def _reduce(problem: Problem, system: _System, damping: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Schur complement: reduced matrix (6N,6N), its gradient (6N,), inverse point blocks (T,3,3)."""
    tracks, count = problem.tracks, len(system.camera)
    inverse = np.linalg.inv(_damped(system.point, damping) + 1e-9 * np.eye(3))
    carried = system.mixed @ inverse[tracks.track]
    coupling = _blocks(carried, tracks, count) @ _blocks(system.mixed, tracks, count).T
    reduced = -coupling.toarray()
    diagonal = np.arange(count)
    reduced.reshape(count, 6, count, 6)[diagonal, :, diagonal] += _damped(system.camera, damping)
    eliminated = np.einsum("mab,mb->ma", carried, system.point_gradient[tracks.track])
    gradient = system.camera_gradient - _sum(_summing(tracks.view, count), eliminated)
    return reduced, gradient.ravel(), inverse


def _damped(blocks: FloatArray, damping: float) -> FloatArray:
    """Blocks (B,K,K) with their diagonals raised by the share `damping`."""
    diagonal = np.einsum("bkk->bk", blocks)
    out: FloatArray = blocks + damping * diagonal[:, :, None] * np.eye(blocks.shape[1])
    return out


def _blocks(mixed: FloatArray, tracks: Tracks, count: int) -> bsr_matrix:
    """Sparse matrix (6N,3T) of the mixed blocks (M,6,3)."""
    order = np.lexsort((tracks.track, tracks.view))
    start = np.searchsorted(tracks.view[order], np.arange(count + 1))
    return bsr_matrix((mixed[order], tracks.track[order], start), shape=(6 * count, 3 * tracks.count))
