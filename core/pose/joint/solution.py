"""Solve the network of photos and tracks: scan ties, noise and outliers found along the way."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import BoolArray, FloatArray, IndexArray
from ...cameras.base import Camera
from ...jobs import Job, part
from ...settings import JointSettings
from ..points.perturbation import camera_points
from .adjustment import (
    Network,
    Noise,
    Prior,
    Problem,
    ScanTies,
    adjust_job,
    estimate_noise,
    without_outliers,
)
from .features import Features, Hits, Surface
from .lens import UNKNOWNS, Lenses
from .reduction import sum_groups, summing
from .residuals import TieResiduals
from .tracks import Tracks, build_tracks

FIRST_ROUNDS, LAST_ROUNDS = 2, 4
"""Times the scan is met anew and outliers are dropped, on the way and where sightings are placed exactly."""

PARTS = 8
"""Parts of a patch's side to which ties are gathered when those around are counted."""


Place = Callable[[Problem, Network], Job[Tracks]]
"""What puts the sightings of a problem where photos show the same."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The adjusted network and the problem it solves, without the outliers."""

    problem: Problem
    network: Network

    @property
    def ties(self) -> IndexArray:
        """Tracks that hold each photo: (N,)."""
        count = len(self.network.centres)
        return np.bincount(self.problem.tracks.view, minlength=count).astype(np.int64)

    def residuals(self, view: int, camera: Camera) -> TieResiduals:
        """What is left of the ties of a photo, seen through its camera."""
        tracks, network = self.problem.tracks, self.network
        mine = tracks.view == view
        points = network.points[tracks.track[mine]]
        pixels = camera.project(camera_points(network.rotations[view], network.centres[view], points))
        seen = np.isfinite(pixels).all(axis=1)
        return TieResiduals(pixels[seen], tracks.pixels[mine][seen] - pixels[seen])


def solve_network_job(
    start: Network,
    prior: Prior,
    features: Sequence[Features],
    hits: Sequence[Hits],
    matches: Mapping[tuple[int, int], IndexArray],
    surface: Surface,
    lenses: Lenses,
    settings: JointSettings,
    place: Place | None = None,
) -> Job[Solution]:
    """Adjust all poses, and the lenses that are free, to matches {(i, j): (M,2)} between photos' features.

    The features' rays are those of the lenses as changed so far; the network's `lenses` are further changes.
    `place`: makes sightings more exact once the first outliers are gone.
    """
    tracks = _held_tracks(build_tracks(features, matches), hits, len(features), settings)
    points = tracks.first_points(hits)
    network = Network(start.rotations, start.centres, points, np.zeros((lenses.count, UNKNOWNS)))
    noise = Noise(pixel=1.0, scan=settings.scan_sigma)
    ties = meet_tracks(network, tracks, surface, settings)
    problem = Problem(tracks, ties, prior, noise, lenses)
    rounds = LAST_ROUNDS if place else FIRST_ROUNDS
    steps = rounds + (place is not None)
    for number in range(rounds if tracks.count else 0):
        ties = meet_tracks(network, problem.tracks, surface, settings)
        problem = replace(problem, ties=ties)
        # before the last round the scan is met anew and outliers go: no need to be exact
        job = adjust_job(problem, network, least_gain=0.0 if number == LAST_ROUNDS - 1 else 1e-3)
        done = number + (place is not None and number > 0)
        network = yield from part(job, done / steps, (done + 1) / steps)
        limit = 8.0 if number == 0 else 4.0
        problem, network = without_outliers(problem, network, limit)
        if problem.tracks.count:
            problem = replace(problem, noise=estimate_noise(problem, network))
        if number == 0 and place:
            placed = yield from part(place(problem, network), 1 / steps, 2 / steps)
            problem = replace(problem, tracks=placed)
    return Solution(problem, network)


def _held_tracks(tracks: Tracks, hits: Sequence[Hits], count: int, settings: JointSettings) -> Tracks:
    """Tracks that meet the scan, of photos that have enough of them."""
    for _ in range(count):
        on_scan = np.isfinite(tracks.first_points(hits)[:, 0])
        enough = np.bincount(tracks.view, minlength=count) >= settings.min_ties
        kept = on_scan[tracks.track] & enough[tracks.view]
        if kept.all():
            break
        tracks = tracks.select(kept)
    return tracks


def meet_tracks(network: Network, tracks: Tracks, surface: Surface, settings: JointSettings) -> ScanTies:
    """Where the scan lies next to each track: the nearest of the places that its lines of sight meet."""
    points = network.points[tracks.track]
    origin = network.centres[tracks.view]
    hits = surface.caster.first_hit(origin, points - origin)
    length = np.linalg.norm(points - origin, axis=1)
    gap = np.abs(hits.distance - length)
    order = np.lexsort((gap, tracks.track))
    first = np.flatnonzero(np.r_[True, tracks.track[order][1:] != tracks.track[order][:-1]])
    nearest = order[first] if len(order) else order
    feet = origin[nearest] + (points - origin)[nearest] * (hits.distance / length)[nearest][:, None]
    # farther than this the point lies on something that is not in the scan
    tied = gap[nearest] < max(20 * settings.scan_sigma, 0.02)
    tied &= hits.face[nearest] >= 0
    normals = surface.normals[np.maximum(hits.face[nearest], 0)]
    share = patch_shares(network.points, tied, settings.patch)
    return ScanTies(np.where(tied[:, None], feet, np.nan), np.where(tied[:, None], normals, np.nan), share)


def patch_shares(points: FloatArray, tied: BoolArray, patch: float) -> FloatArray:
    """One over the number of ties within a disc of `patch` x `patch` m² around: (T,), zero without a tie.

    Around each tie anew: with a grid, ties on either side of a wall along its border would fall into
    different cells, the fewer ones would count more, and all of these err to the same side.
    """
    share = np.zeros(len(points))
    if tied.any():
        cell = np.floor(points[tied] * (PARTS / patch)).astype(np.int64)
        _, inverse, counts = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
        inverse = inverse.ravel()
        middles = sum_groups(summing(inverse, len(counts)), points[tied]) / counts[:, None]
        near = cKDTree(middles).query_pairs(patch / np.sqrt(np.pi), output_type="ndarray")
        around = counts.astype(np.float64)
        np.add.at(around, near[:, 0], counts[near[:, 1]])
        np.add.at(around, near[:, 1], counts[near[:, 0]])
        share[tied] = 1.0 / around[inverse]
    return share
