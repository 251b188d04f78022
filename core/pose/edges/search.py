"""A search around a start that is rougher than usual: several starts, and the pose that stands out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray
from ...geometry.rigid import exp_so3
from ...jobs import Job, Progress
from ...photos.view import View
from ...settings import EdgeSettings
from ..points.perturbation import camera_points
from .alignment import Photo, PosePrior, align_edges, edge_agreement
from .levels import divided_edges, finest_scale, photo_at
from .rendering import Scan
from .scan_edges import ScanEdges, find_scan_edges

TURNS = ((0.0, 0.0), (1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))
"""Turns of the starts about the camera's x and y axes, in standard deviations of the rotation."""

SAME = 3.0
"""Poses whose edges lie within so many pixels of the search's level are one."""

RIVAL = 0.9
"""Share of the best agreement from which another pose makes the search ambiguous."""

AGREEING = 2
"""Starts that have to come to the pose that is chosen."""


@dataclass(frozen=True, eq=False)
class _Candidate:
    """Where one start led: its pose, its edges there and how well those held back agree."""

    rotation: FloatArray
    centre: FloatArray
    edges: ScanEdges
    score: float

    def apart(self, other: _Candidate, photo: Photo) -> float:
        """Median distance (px) between the edges of both poses; infinite where they are not seen."""
        points = self.edges.points
        one, two = (photo.camera.project(camera_points(c.rotation, c.centre, points)) for c in (self, other))
        way = np.linalg.norm(photo.camera.unwrapped(two, one) - one, axis=1)
        seen = np.isfinite(way)
        return float(np.median(way[seen])) if seen.any() else float("inf")


@dataclass(frozen=True, eq=False)
class Start:
    """A pose found by a search: rotation (3,3), centre (3,) m; `unanimous`: every start led to it."""

    rotation: FloatArray
    centre: FloatArray
    unanimous: bool


def search_start_job(view: View, scan: Scan, prior: PosePrior, settings: EdgeSettings) -> Job[Start | None]:
    """Pose near the prior's to which several starts lead and whose edges agree best.

    None where no two starts agree, or where another pose explains the edges nearly as well: in a row of like
    windows a neighbour does.
    """
    finest = finest_scale(view, prior, scan, settings)
    levels = [photo_at(view, finest / 4, scan, settings), photo_at(view, finest / 2, scan, settings)]
    sigma = np.sqrt(np.trace(prior.covariance[:3, :3]) / 3.0)
    candidates = []
    for number, (x, y) in enumerate(TURNS):
        yield Progress(number / len(TURNS), f"Aligning edges from start {number + 1} of {len(TURNS)}")
        rotation = exp_so3([x * sigma, y * sigma, 0.0]) @ prior.rotation
        candidates.append(_followed(levels, scan, rotation, prior, settings))
    photo = levels[1]
    best = max(candidates, key=lambda c: c.score)
    same = [best.apart(c, photo) <= SAME for c in candidates]
    rivals = [c.score for c, is_same in zip(candidates, same, strict=True) if not is_same]
    if sum(same) < AGREEING or max(rivals, default=0.0) > RIVAL * best.score:
        return None
    return Start(best.rotation, best.centre, all(same))


def _followed(
    levels: list[Photo], scan: Scan, rotation: FloatArray, prior: PosePrior, settings: EdgeSettings
) -> _Candidate:
    """Follow one start through the coarse levels."""
    rng = np.random.default_rng(settings.seed)
    wide, narrow = (settings.search / 2, 2.0), (2.0, 1.0)
    centre = prior.centre
    for photo, widths in ((levels[0], wide), (levels[0], narrow), (levels[1], narrow)):
        edges = find_scan_edges(photo.camera, rotation, centre, scan, settings)
        fit, _ = divided_edges(edges, settings, rng)
        alignment = align_edges(photo, fit, rotation, centre, prior, widths)
        rotation, centre = alignment.rotation, alignment.centre
    edges = find_scan_edges(levels[1].camera, rotation, centre, scan, settings)
    _, held = divided_edges(edges, settings, rng)
    return _Candidate(rotation, centre, edges, edge_agreement(levels[1], held, rotation, centre))
