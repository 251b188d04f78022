"""Checks before a refined pose is believed: enough edges, spread, a likely move, halves that agree.

Each note is empty or says in a sentence why the pose was kept.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import eigh
from scipy.stats import chi2

from ...arrays import BoolArray, FloatArray
from ...geometry.rigid import log_so3
from ...settings import EdgeSettings
from ..points.perturbation import invert_scaled
from .alignment import CELLS, Alignment, Photo, PosePrior, align_edges
from .patches import shift_sigma
from .scan_edges import ScanEdges

UNLIKELY = float(chi2.ppf(0.999, 6))
"""Squared Mahalanobis distance of a pose that one right pose in a thousand exceeds."""

RIVAL = 0.85
"""Share of the best fit from which another pose makes a search ambiguous."""

OPEN = 0.5
"""Share of an assumed standard deviation that edges have to get below in every direction."""

CONTRADICTION = 16.0
"""Halves that are four standard deviations apart in every direction contradict each other."""


def few_edges(alignment: Alignment, settings: EdgeSettings) -> str:
    """Note when too few edges of the scan are found in the photo, or in too small a part of it."""
    if alignment.matched < settings.min_edges:
        return (
            f"Only {alignment.matched} edges of the scan have a partner in the photo: the pose was kept."
            " Refine it by points or together with other photos."
        )
    share = alignment.matched / max(alignment.visible, 1)
    if share < settings.min_share:
        return (
            f"Only {share:.0%} of the scan's visible edges have a partner in the photo: the pose was kept. "
            "Check it by its regions; it may be too far off."
        )
    rows, columns = np.divmod(alignment.cells, CELLS)
    if len(alignment.cells) < 6 or min(len(np.unique(rows)), len(np.unique(columns))) < 3:
        return (
            "The edges of the scan lie in one corner or strip of the photo and cannot hold the pose: it was "
            "kept. Refine it by points or together with other photos."
        )
    return ""


def no_agreement(before: float, after: float, settings: EdgeSettings) -> str:
    """Note when edges that took no part in the fit agree badly, or no better than before."""
    if after < settings.min_score:
        return (
            "The photo's edges do not follow those of the scan: the pose was kept. Check it by its regions."
        )
    if after <= before:
        return f"The edges agree no better than before ({before:.2f} to {after:.2f}): the pose was kept."
    return ""


def far_move(alignment: Alignment, prior: PosePrior) -> str:
    """Note when the way from the start is longer than the start's own covariance makes likely."""
    step = pose_difference(alignment.rotation, alignment.centre, prior.rotation, prior.centre)
    if float(step @ invert_scaled(prior.covariance) @ step) <= UNLIKELY:
        return ""
    angle, way = np.degrees(np.linalg.norm(step[:3])), 100 * np.linalg.norm(step[3:])
    return (
        f"The edges would turn the photo by {angle:.2f} degrees and move it by {way:.1f} cm; of poses as "
        "sure as this one not one in a thousand is so far off: it was kept. Improve it by points or regions "
        "first."
    )


def open_direction(covariance: FloatArray, prior: PosePrior) -> str:
    """Note when some direction of the pose is hardly better known than the start was assumed to be.

    An assumption must not hold what the edges leave open; a covariance that the start brought along may.
    """
    left = eigh(covariance, prior.covariance, eigvals_only=True)
    if float(np.sqrt(left[-1])) <= OPEN:
        return ""
    return (
        "The edges leave open a direction in which turning and moving the camera look alike: the pose was "
        "kept. Start from regions or points, which say how sure they are."
    )


def ambiguous(rival: float) -> str:
    """Note when another pose fits nearly as well: `rival` is its share of the best fit."""
    if rival <= RIVAL:
        return ""
    return (
        f"Another pose near the start fits {rival:.0%} as well (in a row of like windows the neighbour does)"
        ": the pose was kept. Refine it by points or together with other photos."
    )


def halves_apart(disagreement: float) -> str:
    """Note when two halves of the photo contradict each other (see `disagreement_of_halves`)."""
    if disagreement <= CONTRADICTION:
        return ""
    return (
        "Two halves of the photo lead to different poses, "
        f"{np.sqrt(disagreement):.0f} times as far apart as their edges allow: the pose was kept. "
        "Improve it by points or regions first, or check the lens and whether the scan shows the same state."
    )


def pose_difference(
    rotation: FloatArray, centre: FloatArray, from_rotation: FloatArray, from_centre: FloatArray
) -> FloatArray:
    """Step (6,) from one pose to another, in the coordinates of `Pose.covariance`."""
    return np.concatenate([log_so3(rotation @ from_rotation.T), centre - from_centre])


def disagreement_of_halves(
    photo: Photo, edges: ScanEdges, alignment: Alignment, prior: PosePrior, widths: tuple[float, ...]
) -> float:
    """Squared difference of the poses of two halves of the photo over what it should be; 1 when all is well.

    The photo is cut once upright, once level, where half of the edges are on either side; the worse cut
    counts. Each half starts at the result and is held there, in the way the start was known but so that
    edges move by half the reach of the matching: a half that cannot hold a pose alone does not drift.
    """
    result = PosePrior(alignment.rotation, alignment.centre, prior.covariance)
    loose = shift_sigma(photo, edges, result) / (photo.search / 2)
    held = replace(result, covariance=prior.covariance / max(loose, 1.0) ** 2)
    first = (edges.pixels <= np.median(edges.pixels, axis=0)).T
    return max(_disagreement(photo, edges, half, held, widths) for half in first)


def _disagreement(
    photo: Photo, edges: ScanEdges, half: BoolArray, held: PosePrior, widths: tuple[float, ...]
) -> float:
    one, other = (
        align_edges(photo, edges.select(part), held.rotation, held.centre, held, widths)
        for part in (half, ~half)
    )
    step = pose_difference(one.rotation, one.centre, other.rotation, other.centre)
    # the common hold has no error of its own: only the edges' errors make the halves differ
    expected = one.edge_errors + other.edge_errors
    return float(step @ invert_scaled(expected) @ step) / 6.0
