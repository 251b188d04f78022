"""Refine the poses of all photos together on the scan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import ArrayLike, FloatArray, IndexArray
from ...jobs import Job, Progress, drain, part
from ...photos.view import View
from ...settings import JointSettings
from ..points.perturbation import camera_points, invert_scaled
from ..points.pictures import view_name
from ..pose import Pose
from .adjustment import Network, Prior, covariances
from .features import Features, Hits, Surface, detect_features, meet_scan
from .matching import choose_pairs_job, match_closely, match_roughly
from .solution import Solution, solve_network_job

Matches = dict[tuple[int, int], IndexArray]


@dataclass(frozen=True, eq=False)
class JointPose(Pose):
    """A pose refined together with others.

    `ties`: tracked scan points that hold the photo, 0 when it kept its pose; `shift_before`, `shift_after`:
    median distance in pixels between its features and those of other photos carried over the scan, NaN
    without any. `note`: why the pose was kept, empty when it was refined.
    """

    ties: int
    shift_before: float
    shift_after: float
    note: str

    @property
    def refined(self) -> bool:
        """Whether the pose was moved."""
        return not self.note


def refine_poses_jointly(
    views: Sequence[View], vertices: ArrayLike, faces: ArrayLike, settings: JointSettings | None = None
) -> list[JointPose]:
    """Poses of all photos, tied by features that lie on the scan; same order as `views`.

    vertices (V,3) m, world; faces (F,3). The scan is fixed and metric. A photo whose features are not found
    in others keeps its pose and says so in `note`. Raises `PhotoError` for a photo that cannot be read.
    Source: bundle adjustment (Triggs et al. 2000) with the points drawn to the scan.
    """
    return drain(refine_poses_jointly_job(views, vertices, faces, settings))


def refine_poses_jointly_job(
    views: Sequence[View], vertices: ArrayLike, faces: ArrayLike, settings: JointSettings | None = None
) -> Job[list[JointPose]]:
    """Job of `refine_poses_jointly`."""
    settings = settings or JointSettings()
    if not views:
        return []
    points = np.asarray(vertices, dtype=np.float64)
    # relative to the scan's middle: world coordinates may be millions of metres
    origin = points.mean(axis=0) if len(points) else np.zeros(3)
    yield Progress(0.0, "Preparing the scan")
    surface = Surface.of_mesh(points - origin, np.asarray(faces, dtype=np.int64))
    features = []
    for number, view in enumerate(views):
        yield Progress(0.02 + 0.4 * number / len(views), f"Features of {view_name(view, number)}")
        features.append(detect_features(view, settings))
    group = _Group(views, features, surface, settings)
    prior = _prior(views, origin, settings)
    network = Network(prior.rotations, prior.centres, np.zeros((0, 3)))
    # rough poses first, with the strongest features; then all features where the better poses expect them
    radii = [group.rough_radius(network, prior), 8.0, 5.0]
    for stage, radius in enumerate(radii):
        low = 0.42 + 0.19 * stage
        hits = group.hits(network)
        matches = yield from part(group.match_job(network, hits, radius, stage == 0), low, low + 0.13)
        job = solve_network_job(network, prior, features, hits, matches, surface, settings)
        solution = yield from part(job, low + 0.13, low + 0.19)
        network = solution.network
    return _poses(group, prior, solution, matches, origin)


def _prior(views: Sequence[View], origin: FloatArray, settings: JointSettings) -> Prior:
    """Starting poses as information, from their covariances or from the settings."""
    sigma = np.repeat([np.radians(settings.rotation_sigma), settings.centre_sigma], 3)
    unknown = np.diag(sigma**-2.0)
    return Prior(
        np.array([view.rotation for view in views]),
        np.array([view.centre - origin for view in views]),
        np.array([unknown if v.covariance is None else invert_scaled(v.covariance) for v in views]),
    )


@dataclass(frozen=True, eq=False)
class _Group:
    """The photos that are refined together."""

    views: Sequence[View]
    features: Sequence[Features]
    surface: Surface
    settings: JointSettings

    def hits(self, network: Network) -> list[Hits]:
        return [
            meet_scan(f.rays, network.rotations[i], network.centres[i], self.surface)
            for i, f in enumerate(self.features)
        ]

    def predicted(self, network: Network, hits: Hits, view: int) -> FloatArray:
        """Pixels (N,2) at which a photo should see the scan points of another's features."""
        in_camera = camera_points(network.rotations[view], network.centres[view], hits.points)
        return self.views[view].camera.project(in_camera)

    def rough_radius(self, network: Network, prior: Prior) -> float:
        """Pixels by which two starting poses may disagree: three standard deviations of each."""
        shifts = []
        for i, hits in enumerate(self.hits(network)):
            points = hits.points[np.isfinite(hits.points[:, 0])]
            if len(points):
                covariance = invert_scaled(prior.information[i])
                angle = np.sqrt(np.trace(covariance[:3, :3]) / 1.5)
                distance = np.median(np.linalg.norm(points - network.centres[i], axis=1))
                angle = np.hypot(angle, np.sqrt(np.trace(covariance[3:, 3:]) / 1.5) / distance)
                shifts.append(angle * np.median(np.linalg.norm(self.features[i].to_pixels[:, 0], axis=1)))
        return float(3.0 * np.sqrt(2.0) * np.max(shifts, initial=1.0))

    def match_job(self, network: Network, hits: Sequence[Hits], radius: float, rough: bool) -> Job[Matches]:
        """Matches of all pairs of photos that see the same surface."""
        poses = list(zip(network.rotations, network.centres, strict=True))
        cameras = [view.camera for view in self.views]
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


def _poses(
    group: _Group, prior: Prior, solution: Solution, matches: Matches, origin: FloatArray
) -> list[JointPose]:
    """The result per photo; those without ties, or not better than before, keep their pose."""
    network, ties = solution.network, solution.ties
    start = Network(prior.rotations, prior.centres, network.points)
    before, after = group.shifts(start, matches), group.shifts(network, matches)
    covariance = covariances(solution.problem, network)
    poses = []
    for i, view in enumerate(group.views):
        note = _reason_to_keep(int(ties[i]), float(before[i]), float(after[i]), group.settings)
        if note:
            kept = invert_scaled(prior.information[i])
            pose = JointPose(
                view.rotation, view.translation, kept, 0, float(before[i]), float(before[i]), note
            )
        else:
            rotation, centre = network.rotations[i], network.centres[i] + origin
            pose = JointPose(
                rotation,
                -rotation @ centre,
                covariance[i],
                int(ties[i]),
                float(before[i]),
                float(after[i]),
                note,
            )
        poses.append(pose)
    return poses


def _reason_to_keep(ties: int, before: float, after: float, settings: JointSettings) -> str:
    if ties < settings.min_ties:
        return (
            f"Only {ties} of its features were found in other photos on the scan: the pose was kept. Add "
            "photos that overlap it, or refine it by edges or points."
        )
    if after > 1.05 * before + 0.2:
        return f"The photos would agree less ({before:.1f} to {after:.1f} pixels): the pose was kept."
    return ""
