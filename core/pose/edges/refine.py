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
    ambiguous,
    disagreement_of_halves,
    far_move,
    few_edges,
    halves_apart,
    no_agreement,
    open_direction,
)
from .levels import divided_edges, finest_scale, photo_at
from .rendering import EdgeScan
from .scan_edges import ScanEdges, find_scan_edges
from .search import Start, search_start_job

WIDTHS = (2.0, 1.0)
"""Widths (px) of the matching in a round, the finer one last."""


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
    edges are used as well. All poses within `view.covariance` (without one: the settings) are searched. The
    pose is kept, and `note` says why, where another pose explains the edges nearly as well, where edges are
    few, crowded or agree no better than before, where it would move further than the covariance makes likely,
    and where two halves of the photo contradict each other; a small contradiction widens the covariance.
    Raises `PhotoError` for a photo that cannot be read. Source: method.md 2.6.
    """
    scan = EdgeScan.centred(vertices, faces, vertex_colors)
    return drain(refine_pose_on_scan_job(view, scan, settings))


def refine_pose_by_edges_job(
    view: View,
    vertices: ArrayLike,
    faces: ArrayLike,
    vertex_colors: ArrayLike | None = None,
    settings: EdgeSettings | None = None,
) -> Job[EdgePose]:
    """Job of `refine_pose_by_edges`."""
    yield Progress(0.0, "Preparing the scan")
    scan = EdgeScan.centred(vertices, faces, vertex_colors)
    return (yield from part(refine_pose_on_scan_job(view, scan, settings), 0.1, 1.0))


def refine_pose_on_scan_job(
    view: View, scan: EdgeScan, settings: EdgeSettings | None = None
) -> Job[EdgePose]:
    """`refine_pose_by_edges` on a scan that was made ready once for many photos, see `EdgeScan.centred`."""
    settings = settings or EdgeSettings()
    prior = _prior(view, scan.origin, settings)
    start = yield from part(search_start_job(view, scan, prior, settings), 0.0, 0.3)
    rotation, centre = start.rotation, start.centre
    finest = finest_scale(view, prior, scan, settings)
    levels = []
    rng = np.random.default_rng(settings.seed)
    for number, scale in enumerate((finest / 2, finest)):
        yield Progress(0.3 + 0.25 * number, f"Aligning edges at {scale:.0%} of the photo")
        photo = photo_at(view, scale, scan, settings)
        edges = find_scan_edges(photo.camera, rotation, centre, scan, settings)
        fit, _ = divided_edges(photo, edges, settings, rng)
        alignment = align_edges(photo, fit, rotation, centre, prior, WIDTHS)
        rotation, centre = alignment.rotation, alignment.centre
        levels.append(photo)
    yield Progress(0.8, "Comparing with the pose before")
    return _decide(_Case(view, scan, settings, prior, start), levels, fit, alignment)


@dataclass(frozen=True, eq=False)
class _Case:
    """A photo and a scan, the pose before with its covariance, and where the search led."""

    view: View
    scan: EdgeScan
    settings: EdgeSettings
    prior: PosePrior
    start: Start


def _prior(view: View, origin: FloatArray, settings: EdgeSettings) -> PosePrior:
    """The starting pose with its covariance; without one, standard deviations per axis."""
    covariance = view.covariance
    if covariance is None:
        sigma = np.repeat([np.radians(settings.rotation_sigma), settings.centre_sigma], 3)
        covariance = np.diag(sigma**2)
    return PosePrior(view.rotation, view.centre - origin, covariance)


def _decide(case: _Case, levels: list[Photo], fit: ScanEdges, alignment: Alignment) -> EdgePose:
    """The refined pose, its covariance widened by the checks, or the old one where the evidence is thin."""
    view, settings, prior = case.view, case.settings, case.prior
    before, after = _agreements(case, levels[0], alignment)
    note = (
        few_edges(alignment, settings)
        or ambiguous(case.start.rival)
        or no_agreement(before, after, settings)
        or far_move(alignment, prior)
    )
    if not note:
        disagreement = disagreement_of_halves(levels[-1], fit, alignment, prior, WIDTHS)
        covariance = alignment.widened(disagreement)
        note = halves_apart(disagreement)
        if view.covariance is None:
            note = note or open_direction(covariance, prior)
    if note:
        return EdgePose(view.rotation, view.translation, prior.covariance, before, before, 0, note)
    centre = alignment.centre + case.scan.origin
    return EdgePose(
        alignment.rotation,
        -alignment.rotation @ centre,
        covariance,
        before,
        after,
        alignment.matched,
        "",
    )


def _agreements(case: _Case, photo: Photo, alignment: Alignment) -> tuple[float, float]:
    """Agreement of the pose before and after with edges that took no part; both judged by those of either."""
    poses = [(case.prior.rotation, case.prior.centre), (alignment.rotation, alignment.centre)]
    rng = np.random.default_rng(case.settings.seed)
    held = [
        divided_edges(
            photo, find_scan_edges(photo.camera, *pose, case.scan, case.settings), case.settings, rng
        )[1]
        for pose in poses
    ]
    before, after = (float(np.mean([edge_agreement(photo, edges, *p) for edges in held])) for p in poses)
    return before, after
