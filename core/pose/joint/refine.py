"""Refine the poses of all photos together on the scan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...arrays import ArrayLike, FloatArray
from ...cameras.base import Camera
from ...jobs import Job, Progress, drain, part
from ...photos.view import View
from ...settings import JointSettings
from ..points.perturbation import invert_scaled
from ..points.pictures import view_name
from ..pose import Pose
from .adjustment import Network, Prior, covariances
from .features import Surface, detect_features
from .group import Group, Matches
from .lens import UNKNOWNS, LensFit, fitted_lens, shared_lenses, why_fixed
from .residuals import TieResiduals
from .solution import Solution


@dataclass(frozen=True, eq=False)
class JointPose(Pose):
    """A pose refined together with others.

    `ties`: tracked scan points that hold the photo, 0 when it kept its pose; `shift_before`, `shift_after`:
    median distance in pixels between its features and those of other photos carried over the scan, NaN
    without any. `note`: why the pose was kept, empty when it was refined. `camera`: the one that belongs to
    the pose; `lens`: what became of its lens, None where lenses were not to be adjusted. `residuals`: what is
    left of each tie, none where the pose was kept.
    """

    ties: int
    shift_before: float
    shift_after: float
    note: str
    camera: Camera
    lens: LensFit | None = None
    residuals: TieResiduals = field(default_factory=TieResiduals.none)

    @property
    def refined(self) -> bool:
        """Whether the pose was moved."""
        return not self.note


def refine_poses_jointly(
    views: Sequence[View],
    vertices: ArrayLike,
    faces: ArrayLike,
    settings: JointSettings | None = None,
    adjust_lenses: bool = False,
) -> list[JointPose]:
    """Poses of all photos, tied by features that lie on the scan; same order as `views`.

    vertices (V,3) m, world; faces (F,3). The scan is fixed and metric. A view's covariance says how well its
    pose is known beforehand, so that a pose from regions or edges keeps what they tell. A photo whose
    features are not found in others keeps its pose and says so in `note`. `adjust_lenses`: focal length,
    principal point and radial distortion of each lens are unknowns too (photos whose cameras have the same
    values share a lens); one that the photos do not determine is kept, see `JointPose.lens`. Raises
    `PhotoError` for a photo that cannot be read. Source: bundle adjustment (Triggs et al. 2000) with
    the points drawn to the scan.
    """
    return drain(refine_poses_jointly_job(views, vertices, faces, settings, adjust_lenses))


def refine_poses_jointly_job(
    views: Sequence[View],
    vertices: ArrayLike,
    faces: ArrayLike,
    settings: JointSettings | None = None,
    adjust_lenses: bool = False,
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
    lenses = shared_lenses(views, False, settings)
    group = Group(views, features, surface, lenses, settings)
    prior = _prior(views, origin, settings)
    network = Network(prior.rotations, prior.centres, np.zeros((0, 3)))
    # rough poses first, with the strongest features; then all features where the better poses expect them
    radii = [group.rough_radius(network, prior), 8.0, 5.0]
    for stage, radius in enumerate(radii):
        low = 0.42 + 0.17 * stage
        if stage == 1:
            group = replace(group, lenses=shared_lenses(views, adjust_lenses, settings))
        matches = yield from part(group.match_job(network, radius, stage == 0), low, low + 0.11)
        solution = yield from part(
            group.solve_job(network, prior, matches, exactly=stage == 2), low + 0.11, low + 0.17
        )
        network, group = solution.network, group.with_lenses(group.lenses.changed(solution.network.lenses))
    adjusted = _Adjusted(group, prior, solution, matches)
    if adjust_lenses:
        adjusted = yield from part(_sure_lenses_job(adjusted), 0.94, 1.0)
    return adjusted.poses(origin)


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
class _Adjusted:
    """An adjusted group; `refused` {lens: fit}: lenses that were tried and kept."""

    group: Group
    prior: Prior
    solution: Solution
    matches: Matches
    refused: Mapping[int, LensFit] = field(default_factory=dict)

    def lens_fits(self, covariance: FloatArray) -> dict[int, LensFit]:
        """What became of the lenses: the adjusted ones with covariances (L,5,5), and the refused ones."""
        lenses, limit = self.group.lenses, self.group.settings.lens_limit
        free = np.flatnonzero(lenses.free).tolist()
        found = {
            k: fitted_lens(lenses, k, of_lens, limit) for k, of_lens in zip(free, covariance, strict=True)
        }
        return {**self.refused, **found}

    def poses(self, origin: FloatArray) -> list[JointPose]:
        """The result per photo; those without ties, or not better than before, keep their pose."""
        group, network, ties = self.group, self.solution.network, self.solution.ties
        start = Network(self.prior.rotations, self.prior.centres, network.points)
        before, after = group.shifts(start, self.matches), group.shifts(network, self.matches)
        covariance, of_lenses = covariances(self.solution.problem, network)
        fits = self.lens_fits(of_lenses)
        poses = []
        for i, view in enumerate(group.views):
            note = _reason_to_keep(int(ties[i]), float(before[i]), float(after[i]), group.settings)
            lens = fits.get(int(group.lenses.of_view[i]))
            if note:
                kept = invert_scaled(self.prior.information[i])
                pose, count, shift = Pose(view.rotation, view.translation, kept), 0, before[i]
            else:
                rotation, centre = network.rotations[i], network.centres[i] + origin
                pose, count, shift = Pose(rotation, -rotation @ centre, covariance[i]), int(ties[i]), after[i]
            # a pose that is kept belongs to the camera that it came with
            camera = view.camera if note else group.camera(i)
            poses.append(
                JointPose(
                    pose.rotation,
                    pose.translation,
                    pose.covariance,
                    count,
                    float(before[i]),
                    float(shift),
                    note,
                    camera,
                    lens,
                    TieResiduals.none() if note else self.solution.residuals(i, camera),
                )
            )
        return poses


def _sure_lenses_job(adjusted: _Adjusted) -> Job[_Adjusted]:
    """Solve again without the lenses that the photos leave open, one after the other, the worst first."""
    group, solution = adjusted.group, adjusted.solution
    refused = {
        lens: LensFit(
            camera, np.zeros(UNKNOWNS), np.full((UNKNOWNS, UNKNOWNS), np.inf), np.inf, why_fixed(camera)
        )
        for lens, camera in enumerate(group.lenses.given)
        if not group.lenses.free[lens]
    }
    adjusted = replace(adjusted, refused=refused)
    while True:
        fits = adjusted.lens_fits(covariances(adjusted.solution.problem, adjusted.solution.network)[1])
        open_ones = {k: fit.pixel_sigma for k, fit in fits.items() if fit.note and k not in adjusted.refused}
        if not open_ones:
            return adjusted
        worst = max(open_ones, key=lambda k: open_ones[k])
        group = group.with_lenses(group.lenses.kept(worst))
        job = group.solve_job(adjusted.solution.network, adjusted.prior, adjusted.matches, exactly=True)
        solution = yield from job
        group = group.with_lenses(group.lenses.changed(solution.network.lenses))
        refused = {**adjusted.refused, worst: fits[worst]}
        adjusted = replace(adjusted, group=group, solution=solution, refused=refused)


def _reason_to_keep(ties: int, before: float, after: float, settings: JointSettings) -> str:
    if ties < settings.min_ties:
        return (
            f"Only {ties} of its features were found in other photos on the scan: the pose was kept. Add "
            "photos that overlap it, or refine it by edges or points."
        )
    if after > 1.05 * before + 0.2:
        return f"The photos would agree less ({before:.1f} to {after:.1f} pixels): the pose was kept."
    return ""
