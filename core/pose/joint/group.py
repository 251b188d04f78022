"""The photos that are refined together: where they meet the scan, what they share, how well they agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import FloatArray, IndexArray
from ...cameras.base import Camera
from ...jobs import Job, Progress, part
from ...photos.view import View
from ...settings import JointSettings
from ..points.perturbation import camera_points, invert_scaled
from ..points.pictures import view_name
from .adjustment import Network, Prior, Problem
from .features import Features, Hits, Surface, meet_scan, resighted
from .lens import Lenses
from .matching import choose_pairs_job, match_closely, match_roughly
from .solution import Solution, solve_network_job
from .templates import place_sightings_job
from .tracks import Tracks

ASTRAY = np.radians(2.0)
"""Angle (rad) within which a feature is looked for at first, however sure the poses are said to be."""

Matches = dict[tuple[int, int], IndexArray]
"""Matches {(i, j): (M,2)} of features of photos i and j."""


@dataclass(frozen=True, eq=False)
class Group:
    """Photos, their features seen through their lenses as changed so far, and the scan."""

    views: Sequence[View]
    features: Sequence[Features]
    surface: Surface
    lenses: Lenses
    settings: JointSettings

    def camera(self, view: int) -> Camera:
        """Camera of a photo, its lens as changed so far."""
        lens = int(self.lenses.of_view[view])
        return self.lenses.camera(lens) if self.lenses.free[lens] else self.views[view].camera

    def with_lenses(self, lenses: Lenses) -> Group:
        """The same photos seen through other lenses."""
        group = replace(self, lenses=lenses)
        features = [resighted(f, group.camera(i)) for i, f in enumerate(self.features)]
        return replace(group, features=features)

    def hits(self, network: Network) -> list[Hits]:
        """Where each photo's features meet the scan."""
        return [
            meet_scan(f.rays, network.rotations[i], network.centres[i], self.surface)
            for i, f in enumerate(self.features)
        ]

    def predicted(self, network: Network, hits: Hits, view: int) -> FloatArray:
        """Pixels (N,2) at which a photo should see the scan points of another's features."""
        in_camera = camera_points(network.rotations[view], network.centres[view], hits.points)
        return self.camera(view).project(in_camera)

    def rough_radius(self, network: Network, prior: Prior) -> float:
        """Pixels by which two starting poses may disagree: three standard deviations of each.

        At least `ASTRAY`: a few poses are off by more than they say.
        """
        shifts, far = [], []
        for i, hits in enumerate(self.hits(network)):
            points = hits.points[np.isfinite(hits.points[:, 0])]
            if len(points):
                covariance = invert_scaled(prior.information[i])
                angle = np.sqrt(np.trace(covariance[:3, :3]) / 1.5)
                distance = np.median(np.linalg.norm(points - network.centres[i], axis=1))
                angle = np.hypot(angle, np.sqrt(np.trace(covariance[3:, 3:]) / 1.5) / distance)
                per_radian = np.median(np.linalg.norm(self.features[i].to_pixels[:, 0], axis=1))
                shifts.append(angle * per_radian)
                far.append(ASTRAY * per_radian)
        return float(max(3.0 * np.sqrt(2.0) * np.max(shifts, initial=1.0), np.max(far, initial=1.0)))

    def match_job(self, network: Network, radius: float, rough: bool) -> Job[Matches]:
        """Matches of all pairs of photos that see the same surface."""
        hits = self.hits(network)
        poses = list(zip(network.rotations, network.centres, strict=True))
        cameras = [self.camera(i) for i in range(len(self.views))]
        chosen = choose_pairs_job(cameras, poses, hits, self.surface, self.settings)
        pairs = yield from part(chosen, 0.0, 0.1)
        matches: Matches = {}
        for number, (i, j) in enumerate(pairs):
            names = f"{view_name(self.views[i], i)} with {view_name(self.views[j], j)}"
            yield Progress(0.1 + 0.9 * number / len(pairs), f"Matching {names}")
            a, b = self.features[i], self.features[j]
            predicted = self.predicted(network, hits[i], j)
            if rough:
                matches[i, j] = match_roughly(a, b, hits[i], predicted, radius, self.settings)
            else:
                matches[i, j] = match_closely(a, b, predicted, radius)
        return matches

    def shifts(self, network: Network, matches: Matches) -> FloatArray:
        """Median distance in pixels (N,) between features and those of others carried over the scan."""
        hits = self.hits(network)
        distances: list[list[FloatArray]] = [[] for _ in self.views]
        for (i, j), pairs in matches.items():
            for a, b, of_a, of_b in ((i, j, pairs[:, 0], pairs[:, 1]), (j, i, pairs[:, 1], pairs[:, 0])):
                carried = self.predicted(network, hits[a], b)[of_a]
                distances[b].append(np.linalg.norm(carried - self.features[b].pixels[of_b], axis=1))
        medians = [np.concatenate([*d, np.zeros(0)]) for d in distances]
        return np.array([np.median(m[np.isfinite(m)]) if np.isfinite(m).any() else np.nan for m in medians])

    def solve_job(self, network: Network, prior: Prior, matches: Matches, exactly: bool) -> Job[Solution]:
        """Adjust poses and free lenses to matches, from the poses of a network.

        `exactly`: what the photos show around each tie places it, not the feature.
        """
        hits = self.hits(network)
        return solve_network_job(
            network,
            prior,
            self.features,
            hits,
            matches,
            self.surface,
            self.lenses,
            self.settings,
            self._place_job if exactly else None,
        )

    def _place_job(self, problem: Problem, network: Network) -> Job[Tracks]:
        changed = replace(self, lenses=self.lenses.changed(network.lenses))
        cameras = [changed.camera(i) for i in range(len(self.views))]
        return place_sightings_job(self.views, cameras, problem, network, self.settings.photo_size)
