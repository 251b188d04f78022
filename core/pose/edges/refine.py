"""Refine the pose of one photo by the edges of the scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import ArrayLike, FloatArray
from ...jobs import Job, Progress, drain, part
from ...photos.view import View
from ...settings import EdgeSettings
from ..pose import Pose
from .alignment import Alignment, Photo, PosePrior, align_edges, edge_agreement
from .checks import (
    disagreement_of_halves,
    far_move,
    few_edges,
    halves_apart,
    image_shift,
    likely_move,
    no_agreement,
)
from .levels import divided_edges, finest_scale, photo_at
from .rendering import Scan
from .scan_edges import find_scan_edges
from .search import Start, search_start_job


@dataclass(frozen=True, eq=False)
class EdgePose(Pose):
    """A pose refined by edges.

    `score_before`, `score_after`: how much stronger the photo's edges are where the scan's fall than beside
    them, 1 where they have nothing to do with each other, measured on edges that took no part in the fit.
    `edges`: edge points that hold the pose. `note`: why the pose was kept, empty when it was refined.
    """

    score_before: float
    score_after: float
    edges: int
    note: str

    @property
    def refined(self) -> bool:
        """Whether the pose was moved."""
        return not self.note


def refine_pose_by_edges(
    view: View,
    vertices: ArrayLike,
    faces: ArrayLike,
    vertex_colors: ArrayLike | None = None,
    settings: EdgeSettings | None = None,
) -> EdgePose:
    """Pose of a photo, moved until the edges of the scan fall on those of the photo.

    vertices (V,3) m, world; faces (F,3); vertex_colors (V,3) or intensities (V,), bytes or 0 to 1: their
    edges are used as well. The pose is kept, and `note` says why, where edges are few, crowded or agree no
    better than before, where it would move further than `view.covariance` (without one: the settings) makes
    likely, and where two halves of the photo contradict each other; a small contradiction widens the
    covariance. Raises `PhotoError` for a photo that cannot be read. Source: method.md 2.6.
    """
    return drain(refine_pose_by_edges_job(view, vertices, faces, vertex_colors, settings))


def refine_pose_by_edges_job(
    view: View,
    vertices: ArrayLike,
    faces: ArrayLike,
    vertex_colors: ArrayLike | None = None,
    settings: EdgeSettings | None = None,
) -> Job[EdgePose]:
    """Job of `refine_pose_by_edges`."""
    settings = settings or EdgeSettings()
    yield Progress(0.0, "Preparing the scan")
    points = np.asarray(vertices, dtype=np.float64)
    # relative to the scan's middle: world coordinates may be millions of metres
    origin = points.mean(axis=0) if len(points) else np.zeros(3)
    scan = Scan.of_mesh(points - origin, faces, vertex_colors)
    case = _Case(view, origin, scan, settings)
    prior = _prior(view, origin, settings.rotation_sigma, settings.centre_sigma)
    pose = yield from part(_refined_job(case, prior, None), 0.1, 0.5)
    if pose.refined and (view.covariance is not None or likely_move(pose, origin, prior)):
        return pose
    # where nobody said how rough the start is, it seems to be rougher than usual
    rough = _prior(view, origin, settings.far_rotation_sigma, settings.far_centre_sigma)
    start = yield from part(search_start_job(view, scan, rough, settings), 0.5, 0.8)
    if start is None:
        return pose
    farther = yield from part(_refined_job(case, rough, start), 0.8, 1.0)
    return farther if farther.refined and farther.score_after > pose.score_after else pose


@dataclass(frozen=True, eq=False)
class _Case:
    """What is refined: a photo against a scan whose coordinates are relative to `origin` (3,) m."""

    view: View
    origin: FloatArray
    scan: Scan
    settings: EdgeSettings


def _refined_job(case: _Case, prior: PosePrior, start: Start | None) -> Job[EdgePose]:
    """Align from the prior's pose, or from a `start` that a search found, and decide."""
    scan, settings = case.scan, case.settings
    rotation, centre = (start or prior).rotation, (start or prior).centre
    rng = np.random.default_rng(settings.seed)
    rounds = _rounds(finest_scale(case.view, prior, scan, settings), start is not None, settings)
    alignment, photo, last_scale = None, None, 0.0
    for number, (scale, widths) in enumerate(rounds):
        yield Progress(0.8 * number / len(rounds), f"Aligning edges at {scale:.0%} of the photo")
        if photo is None or scale != last_scale:
            photo, last_scale = photo_at(case.view, scale, scan, settings), scale
        edges = find_scan_edges(photo.camera, rotation, centre, scan, settings)
        fit, _ = divided_edges(edges, settings, rng)
        alignment = align_edges(photo, fit, rotation, centre, prior, widths)
        rotation, centre = alignment.rotation, alignment.centre
    yield Progress(0.9, "Comparing with the pose before")
    assert photo is not None and alignment is not None
    return _decide(case, photo, prior, alignment, start)


def _rounds(finest: float, near: bool, settings: EdgeSettings) -> list[tuple[float, tuple[float, ...]]]:
    """Image scale and matching widths (px) of each round; the scan is rendered anew in each.

    A start that is `near` already, from a search, needs no coarse ones.
    """
    wide, narrow = (settings.search / 2, 2.0), (2.0, 1.0)
    coarse = [
        (finest / 4, wide),
        (finest / 4, narrow),
        (finest / 2, narrow),
    ]
    fine = [(finest / 2, narrow), (finest, narrow), (finest, (1.0,))]
    return fine if near else coarse + fine


def _prior(view: View, origin: FloatArray, degrees: float, metres: float) -> PosePrior:
    """The starting pose with its covariance; without one, standard deviations per axis."""
    covariance = view.covariance
    if covariance is None:
        sigma = np.repeat([np.radians(degrees), metres], 3)
        covariance = np.diag(sigma**2)
    return PosePrior(view.rotation, view.centre - origin, covariance)


def _decide(
    case: _Case, photo: Photo, prior: PosePrior, alignment: Alignment, start: Start | None
) -> EdgePose:
    """The refined pose, its covariance widened by the checks, or the old one where the evidence is thin."""
    view, settings = case.view, case.settings
    poses = [(prior.rotation, prior.centre), (alignment.rotation, alignment.centre)]
    rng = np.random.default_rng(settings.seed)
    # both poses are judged by the edges seen from either
    seen = [
        divided_edges(find_scan_edges(photo.camera, *pose, case.scan, settings), settings, rng)
        for pose in poses
    ]
    before, after = (float(np.mean([edge_agreement(photo, held, *p) for _, held in seen])) for p in poses)
    note = (
        few_edges(alignment, settings) or no_agreement(before, after, settings) or far_move(alignment, prior)
    )
    if not note:
        widths = (settings.search / 2, 2.0, 1.0)
        fit = seen[1][0]
        disagreement = disagreement_of_halves(photo, fit, alignment, prior, widths)
        # the first round matches at a quarter of this level, half of the search wide
        reach = 4 * settings.search / 2
        if start is not None:
            # a wrong edge is not what all starts agree on and what the photo shows clearly
            reach = np.inf if start.unanimous and after >= settings.strong_score else 0.0
        note = halves_apart(disagreement, image_shift(photo, fit, alignment, prior), reach)
    if note:
        return EdgePose(view.rotation, view.translation, prior.covariance, before, before, 0, note)
    centre = alignment.centre + case.origin
    return EdgePose(
        alignment.rotation,
        -alignment.rotation @ centre,
        alignment.widened(disagreement),
        before,
        after,
        alignment.matched,
        "",
    )
