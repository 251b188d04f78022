"""A search over all poses that the start may stand for: patches of edges vote, rivals are told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray
from ...jobs import Job, Progress
from ...photos.view import View
from ...settings import EdgeSettings
from ..points.perturbation import step_pose
from .alignment import Photo, PosePrior
from .levels import finest_scale, photo_at
from .patches import PatchMaps, patch_maps, shift_sigma
from .rendering import EdgeScan
from .scan_edges import ScanEdges, find_scan_edges

SIZE = 400.0
"""Longer side (px) at which the photo is looked at first."""

REACH = 32
"""Shift (px) that three deviations of the start should make: the photo is searched at the size for it."""

SMALLEST = 100.0
"""Longer side (px) below which a photo shows nothing."""

SAMPLES = 6000
"""Poses tried, drawn from the start's covariance."""

WIDER = 1.2
"""Samples are spread by so much more than the start's covariance."""

APART = 4.0
"""Root mean square shift (px) of patches from which two poses are different ones."""

PLACES = 8
"""Most different poses that are followed up."""

CLOSE = 300
"""Poses tried around one that is followed up, at each spread."""

SOFT = 1.5
"""Width (px) by which peaks are widened while samples lie far apart, so that none falls between them."""

SHRINKING = (0.4, 0.2, 0.1, 0.05, 0.025)
"""Spread of the samples around a pose that is followed up, as a share of the start's.

The first two look at widened peaks.
"""


@dataclass(frozen=True, eq=False)
class Start:
    """The pose whose patches fit best: rotation (3,3), centre (3,) m.

    `rival`: how well the best of the different poses fits, as a share.
    """

    rotation: FloatArray
    centre: FloatArray
    rival: float


def search_start_job(view: View, scan: EdgeScan, prior: PosePrior, settings: EdgeSettings) -> Job[Start]:
    """Pose within the prior's covariance to which most patches of the scan's edges shift.

    Without any edges it is the prior's. Source: likelihood of template maps summed over a rigid set of
    patches, as in pictorial structures (Fischler and Elschlager 1973), sampled from the prior.
    """
    yield Progress(0.0, "Looking at the edges of the scan")
    largest = max(view.camera.width, view.camera.height)
    scale = min(1.0, SIZE / largest)
    photo, edges, sigma = _seen(view, scale, scan, prior, settings)
    if sigma > 0 and not 0.75 * REACH < 3 * sigma < 1.25 * REACH:
        finest = finest_scale(view, prior, scan, settings)
        scale = float(np.clip(scale * REACH / (3 * sigma), min(SMALLEST / largest, finest), finest))
        photo, edges, sigma = _seen(view, scale, scan, prior, settings)
    yield Progress(0.3, "Shifting patches of edges over the photo")
    rng = np.random.default_rng(settings.seed)
    maps = patch_maps(photo, edges, prior, reach=int(np.clip(np.ceil(3 * sigma), 4, 2 * REACH)), rng=rng)
    if not len(maps):
        return Start(prior.rotation, prior.centre, 0.0)
    yield Progress(0.7, "Trying poses around the start")
    spread = _square_root(prior.covariance)
    found = [_followed(maps, place, spread, rng) for place in _places(maps, spread, rng)]
    fits = maps.fit(np.array(found))
    best = int(np.argmax(fits))
    rivals = fits[maps.apart(np.array(found), found[best]) > APART]
    rival = float(max(rivals, default=0.0) / max(fits[best], 1e-9))
    return Start(*step_pose(prior.rotation, prior.centre, found[best]), rival)


def _seen(
    view: View, scale: float, scan: EdgeScan, prior: PosePrior, settings: EdgeSettings
) -> tuple[Photo, ScanEdges, float]:
    """The photo at a scale, the scan's edges in it, and the prior's standard deviation there (px)."""
    photo = photo_at(view, scale, scan, settings)
    edges = find_scan_edges(photo.camera, prior.rotation, prior.centre, scan, settings)
    return photo, edges, shift_sigma(photo, edges, prior)


def _square_root(covariance: FloatArray) -> FloatArray:
    """Matrix (6,6) that turns independent numbers into steps of this covariance, units apart or not."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-18))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    out: FloatArray = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return out


def _places(maps: PatchMaps, spread: FloatArray, rng: np.random.Generator) -> list[FloatArray]:
    """Steps that fit best among samples, each different from the ones before."""
    steps = np.vstack([np.zeros(6), WIDER * rng.normal(size=(SAMPLES, 6)) @ spread.T])
    steps = steps[np.argsort(-maps.smoothed(SOFT).fit(steps), kind="stable")]
    places: list[FloatArray] = []
    while len(steps) and len(places) < PLACES:
        places.append(steps[0])
        steps = steps[maps.apart(steps, steps[0]) > APART]
    return places


def _followed(maps: PatchMaps, step: FloatArray, spread: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Best step (6,) near another: samples around the best one so far, ever closer."""
    rough = maps.smoothed(SOFT)
    for number, share in enumerate(SHRINKING):
        near = np.vstack([step, step + share * rng.normal(size=(CLOSE, 6)) @ spread.T])
        step = near[np.argmax((rough if number < 2 else maps).fit(near))]
    return step
