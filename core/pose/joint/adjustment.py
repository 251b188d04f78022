"""Least squares over all poses and all tracked points, with the points drawn to the scan.

The points are eliminated (Schur complement), so that the system to solve has six unknowns per photo.
Source: Triggs et al. 2000, "Bundle adjustment — a modern synthesis"; the scan enters as one point-to-plane
equation per track.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ...arrays import BoolArray, FloatArray
from ...geometry.rigid import exp_so3, log_so3
from ...jobs import Job, Progress, drain
from ..points.perturbation import camera_point_jacobian, invert_scaled
from ..points.sightings import reprojection
from .lens import UNKNOWNS, Lenses
from .reduction import System, reduce_system, solve_system, sum_groups, summing
from .tracks import Tracks

LOSS = 2.5
"""Width of the Cauchy loss in standard deviations."""

PARTS = 4
"""Parts along a photo's longer side; sightings of one part may err together."""


@dataclass(frozen=True, eq=False)
class Network:
    """What is adjusted: rotations (N,3,3), centres (N,3) m, points (T,3) m, changes of lenses (L,5)."""

    rotations: FloatArray
    centres: FloatArray
    points: FloatArray
    lenses: FloatArray = field(default_factory=lambda: np.zeros((0, UNKNOWNS)))

    def moved(self, cameras: FloatArray, points: FloatArray, lenses: FloatArray | None = None) -> Network:
        """Apply steps of the cameras (N,6), the points (T,3) and the lenses (L,5)."""
        return Network(
            exp_so3(cameras[:, :3]) @ self.rotations,
            self.centres + cameras[:, 3:],
            self.points + points,
            self.lenses if lenses is None else self.lenses + lenses,
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
    """Standard deviations: `pixel` of the smallest features (px), `scan` of the surface (m).

    `alike` >= 1: sightings that count as one, since those of one part of a photo err together (a lens that is
    known to a few hundredths of a pixel).
    """

    pixel: float
    scan: float
    alike: float = 1.0


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything that stays while the network moves."""

    tracks: Tracks
    ties: ScanTies
    prior: Prior
    noise: Noise
    lenses: Lenses

    def residuals(self, network: Network) -> tuple[FloatArray, FloatArray]:
        """Whitened lengths: of the sightings (M,) and of the scan ties (T,), 0 without a tie."""
        pixel = self.sight(network)[0]
        sight = np.linalg.norm(pixel, axis=1) / (self.noise.pixel * self.tracks.size)
        return sight, np.abs(self._scan_residuals(network))

    def sight(self, network: Network) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Errors (M,2) px of the sightings, derivative (M,2,3) by camera points, camera points (M,3)."""
        towards = in_camera(network, self.tracks)
        pixel, by_point = reprojection(self.tracks.rays, self.tracks.to_pixels, towards)
        if self.lenses.count:
            # with rays of the unchanged lens a longer focal length would shrink residuals and win for that
            changed = self.lenses.changed(network.lenses)
            exact, exact_by_point = changed.reprojection(self.tracks.view, self.tracks.pixels, towards)
            known = np.isfinite(exact).all(axis=1)
            pixel[known], by_point[known] = exact[known], exact_by_point[known]
        return pixel, by_point, towards

    def _scan_residuals(self, network: Network) -> FloatArray:
        away = np.einsum("tk,tk->t", network.points - self.ties.feet, self.ties.normals)
        out: FloatArray = np.nan_to_num(away) / self.noise.scan
        return out

    def linearise(self, network: Network) -> System:
        """Normal equations at a network, robustly weighted."""
        tracks, count = self.tracks, len(network.centres)
        pixel, by_point, towards = self.sight(network)
        white = 1.0 / (self.noise.pixel * tracks.size)
        squared = np.einsum("mi,mi->m", pixel, pixel) * white**2
        cost, weight = _robust(squared)
        cost, weight = cost / self.noise.alike, weight * white**2 / self.noise.alike
        rotations = network.rotations[tracks.view]
        by_camera = by_point @ _camera_jacobians(rotations, towards)
        by_world = by_point @ rotations
        if self.lenses.count:
            # where the point is, not where it was seen: slopes that share the residuals' noise are biased
            slopes = self.lenses.changed(network.lenses).slopes(tracks.view, towards)
            by_camera = np.concatenate([by_camera, slopes], axis=2)
        weighted = by_camera * weight[:, None, None]
        weighted_world = by_world * weight[:, None, None]
        turned = np.swapaxes(weighted, 1, 2)
        across: FloatArray = np.matmul(turned, by_world)
        outer_point: FloatArray = np.matmul(np.swapaxes(weighted_world, 1, 2), by_world)
        to_view = summing(tracks.view, count)
        to_track = summing(tracks.track, tracks.count)
        scan_cost, point, point_gradient = self._scan_system(network)
        prior_cost, camera, camera_gradient = self._prior_system(network)
        lens_cost, lens, lens_gradient = self._lens_system(network)
        outer = sum_groups(to_view, turned @ by_camera)
        pull = sum_groups(to_view, np.einsum("mia,mi->ma", weighted, pixel))
        outer[:, :6, :6] += camera
        pull[:, :6] += camera_gradient
        return System(
            outer,
            point + sum_groups(to_track, outer_point),
            across,
            pull,
            point_gradient + sum_groups(to_track, np.einsum("mia,mi->ma", weighted_world, pixel)),
            lens,
            lens_gradient,
            self.lenses.column,
            float(cost.sum()) + scan_cost + prior_cost + lens_cost,
        )

    def _lens_system(self, network: Network) -> tuple[float, FloatArray, FloatArray]:
        """Cost, information (L,5,5) and gradient (L,5) of the lenses' given values."""
        free = np.flatnonzero(self.lenses.free)
        information = self.lenses.information[free]
        change = self.lenses.total[free] + network.lenses
        pulled = information * change
        return float((change * pulled).sum()), information[:, :, None] * np.eye(UNKNOWNS), pulled

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


def adjust(problem: Problem, network: Network, iterations: int = 25, least_gain: float = 0.0) -> Network:
    """Levenberg–Marquardt over all photos and points.

    Ends where a step lessens the cost (squared standard deviations) by less than a hundredth per photo, or
    by the share `least_gain`.
    """
    return drain(adjust_job(problem, network, iterations, least_gain))


def adjust_job(
    problem: Problem, network: Network, iterations: int = 25, least_gain: float = 0.0
) -> Job[Network]:
    """Job of `adjust`: one step per iteration."""
    system = problem.linearise(network)
    damping, slight = 1e-4, 0.01 * len(network.centres)
    for number in range(iterations):
        yield Progress(number / iterations, f"Adjusting {problem.tracks.count} points")
        trial = network.moved(*solve_system(problem.tracks, system, damping))
        trial_system = problem.linearise(trial)
        if trial_system.cost >= system.cost:
            damping *= 10
            if damping > 1e6:
                break
            continue
        gain = system.cost - trial_system.cost
        network, system, damping = trial, trial_system, max(damping * 0.1, 1e-9)
        if gain < max(slight, least_gain * system.cost):
            break
    return network


def covariances(problem: Problem, network: Network) -> tuple[FloatArray, FloatArray]:
    """Covariance (N,6,6) of every pose and (L,5,5) of every lens, all others and the points free.

    What regions and edges of the scan told of the poses may be wrong alike in all photos: where these lie
    together, it counts as if one photo had told it.
    """
    tied = max(len(np.unique(problem.tracks.view)), 1)
    prior = replace(problem.prior, information=problem.prior.information / tied)
    system = replace(problem, prior=prior).linearise(network)
    full = invert_scaled(reduce_system(problem.tracks, system, 0.0).matrix)
    count, lenses = len(network.centres), len(network.lenses)
    poses = full[: 6 * count, : 6 * count].reshape(count, 6, count, 6)
    rest = full[6 * count :, 6 * count :].reshape(lenses, UNKNOWNS, lenses, UNKNOWNS)
    each, one = np.arange(count), np.arange(lenses)
    return poses[each, :, each], rest[one, :, one]


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
    noise = Noise(float(np.clip(pixel, 0.02, 5.0)), float(np.clip(scan_sigma, 1e-4, 0.2)))
    return replace(noise, alike=_erring_together(replace(problem, noise=noise), network))


def _erring_together(problem: Problem, network: Network) -> float:
    """Variance of sums of sightings over parts of photos, by that of independent ones; at least 1.

    Source: the design effect of cluster samples, Kish 1965.
    """
    tracks = problem.tracks
    pixel = problem.sight(network)[0] / (problem.noise.pixel * tracks.size)[:, None]
    pulls = pixel * _robust(np.einsum("mi,mi->m", pixel, pixel))[1][:, None]
    reach = np.zeros(len(network.centres))
    np.maximum.at(reach, tracks.view, tracks.pixels.max(axis=1) + 1.0)
    place = np.floor(PARTS * tracks.pixels / reach[tracks.view, None])
    part_of = np.unique(np.column_stack([tracks.view, place]), axis=0, return_inverse=True)[1].ravel()
    together = np.array([np.bincount(part_of, pull) for pull in pulls.T])
    return float(max(1.0, (together**2).sum() / max(float((pulls**2).sum()), 1e-12)))


def _spent_on_scan(problem: Problem, system: System) -> FloatArray:
    """Share (T,) of each scan equation that goes into its point."""
    inverse = np.linalg.inv(system.point + 1e-9 * np.eye(3))
    normal = np.nan_to_num(problem.ties.normals) / problem.noise.scan
    share = problem.ties.share * np.einsum("ta,tab,tb->t", normal, inverse, normal)
    spent: FloatArray = np.clip(share, 0.0, 1.0)
    return spent


def without_outliers(problem: Problem, network: Network, limit: float) -> tuple[Problem, Network]:
    """Drop sightings and tracks with whitened residuals beyond `limit`."""
    sight, scan = problem.residuals(network)
    in_front = np.einsum("mk,mk->m", in_camera(network, problem.tracks), problem.tracks.rays) > 0
    kept = (sight < limit) & in_front & (scan < limit)[problem.tracks.track]
    return _selected(problem, network, kept)


def _selected(problem: Problem, network: Network, kept: BoolArray) -> tuple[Problem, Network]:
    tracks = problem.tracks.select(kept)
    seen = np.bincount(problem.tracks.track[kept], minlength=problem.tracks.count) >= 2
    ties = ScanTies(problem.ties.feet[seen], problem.ties.normals[seen], problem.ties.share[seen])
    return replace(problem, tracks=tracks, ties=ties), replace(network, points=network.points[seen])


def in_camera(network: Network, tracks: Tracks) -> FloatArray:
    """Points of the sightings in their cameras: (M,3)."""
    away = network.points[tracks.track] - network.centres[tracks.view]
    out: FloatArray = np.einsum("mij,mj->mi", network.rotations[tracks.view], away)
    return out


def _camera_jacobians(rotations: FloatArray, towards: FloatArray) -> FloatArray:
    out = camera_point_jacobian(np.eye(3), towards)
    out[:, :, 3:] = -rotations
    return out


def _robust(squared: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cauchy loss of squared whitened residuals: values and weights."""
    return LOSS**2 * np.log1p(squared / LOSS**2), 1.0 / (1.0 + squared / LOSS**2)
