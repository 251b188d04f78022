"""Many cameras and planes at once: a bundle adjustment on regions, without matches and without a scan."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray
from ..cameras.base import Camera
from ..errors import PoseNotFound, RegionError
from ..jobs import Job, Progress, drain
from ..regions import ImageRegion
from .adjustment import by_maps, by_moments, by_outlines, overlap
from .estimate import OVERLAP_LIMIT
from .network import Link, Network, links_of, reaching
from .starts import decomposed_start, maps_of, turned_start
from .views import ORDER, RegionView, region_view

_ORDERS = ((2, 8), (3, 8), (4, 10), (ORDER, 25))  # of the moments, and most steps with them
_ODD = 5.0  # times the median misfit of a homography from which it is left out
_ODD_ANGLE = 0.02  # rad, a misfit that is never odd


@dataclass(frozen=True, eq=False)
class PosesAndPlanes:
    """Cameras and planes in the reference's frame; unpacks to rotations, translations, normals, distances.

    `X_k = rotations[k] @ X + translations[k]` (M,3,3), (M,3); `normals[i] . X = distances[i]` (N,3), (N,).
    Regions know no scale: the first plane found is at distance 1. NaN stands for cameras and planes
    that could not be placed. `overlap_errors` (M,N), percent, compare each camera's region with that of the
    plane's first view, NaN where it is not used; `locked`: the outlines were found to coincide.
    """

    rotations: FloatArray
    translations: FloatArray
    normals: FloatArray
    distances: FloatArray
    overlap_errors: FloatArray
    locked: bool

    def __iter__(self) -> Iterator[FloatArray]:
        return iter((self.rotations, self.translations, self.normals, self.distances))


def estimate_poses_and_planes(
    cameras: Sequence[Camera], regions: Sequence[Sequence[ImageRegion | None]], reference: int = 0
) -> PosesAndPlanes:
    """Cameras and planes from regions: `regions[k][i]` is plane i as camera k sees it, or None.

    Raises
    ------
    RegionError
        Numbers that do not fit, or a region that cannot be used.
    PoseNotFound
        No photo shares a plane with the reference, or none of the regions agree.

    Source: method.md 5.3, Alg. 6, in a chart per region with whitened moments, orders freed one after the
    other; started from homographies between pairs; then the outlines themselves, robustly.
    """
    return drain(estimate_poses_and_planes_job(cameras, regions, reference))


def estimate_poses_and_planes_job(
    cameras: Sequence[Camera], regions: Sequence[Sequence[ImageRegion | None]], reference: int = 0
) -> Job[PosesAndPlanes]:
    """Like `estimate_poses_and_planes`, in steps."""
    _check(cameras, regions, reference)
    yield Progress(0.0, "Reading the regions' outlines")
    views = [
        [None if region is None else region_view(camera, region) for region in row]
        for camera, row in zip(cameras, regions, strict=True)
    ]
    links, network = yield from _started_job(views, reference)
    network = yield from _by_moments_job(network, links)
    agreeing = reaching([link for link in links if overlap(network, link) < OVERLAP_LIMIT], reference)
    if 0 < len(agreeing) < len(links):
        network = yield from _by_moments_job(network, agreeing)
    if not agreeing:
        raise PoseNotFound(
            "The regions do not agree on any cameras and planes: check that each marks one flat thing, the "
            "same in all photos."
        )
    yield Progress(0.8, "Fitting the outlines")
    network, locked = by_outlines(network, agreeing)
    return _result(network, agreeing, locked)


def _started_job(
    views: Sequence[Sequence[RegionView | None]], reference: int
) -> Job[tuple[list[Link], Network]]:
    """The links whose homographies agree with each other, and cameras and planes that explain them."""
    found = maps_of(links_of(views, reference))
    while True:
        turned, known = turned_start(views, found, reference)
        found = {link: maps for link, maps in found.items() if known[link.first] and known[link.second]}
        if not found:
            raise PoseNotFound(
                "No photo shows a plane of the reference: choose a reference that shares regions."
            )
        yield Progress(0.15, "Turning the cameras towards each other")
        fits = [by_maps(start, found) for start in (turned, decomposed_start(turned, found))]
        network, off = min(fits, key=lambda fit: sum(value**2 for value in fit[1].values()))
        worst = max(off, key=lambda link: off[link])
        if off[worst] < max(_ODD * float(np.median(list(off.values()))), _ODD_ANGLE):
            return list(found), network
        del found[worst]


def _check(
    cameras: Sequence[Camera], regions: Sequence[Sequence[ImageRegion | None]], reference: int
) -> None:
    if len(cameras) < 2 or len(regions) != len(cameras):
        raise RegionError(
            f"{len(regions)} lists of regions for {len(cameras)} cameras: every camera needs its list, and "
            "there have to be at least two."
        )
    if len({len(row) for row in regions}) > 1 or not regions[0]:
        raise RegionError(
            "Every camera needs one entry per plane: its region, or None where it does not see it."
        )
    if not 0 <= reference < len(cameras):
        raise RegionError(
            f"There is no camera {reference} to refer to: they count from 0 to {len(cameras) - 1}."
        )


def _by_moments_job(network: Network, links: Sequence[Link]) -> Job[Network]:
    """The network by the moments of all links, low orders first."""
    for number, (order, rounds) in enumerate(_ORDERS):
        yield Progress(0.2 + 0.1 * number, "Adjusting cameras and planes")
        network = by_moments(network, links, order, rounds)
    return network


def _result(network: Network, links: Sequence[Link], locked: bool) -> PosesAndPlanes:
    cameras, planes = len(network.rotations), len(network.inverse_normals)
    errors = np.full((cameras, planes), np.nan)
    placed = np.zeros(cameras, dtype=np.bool_)
    placed[network.reference] = True
    for link in links:
        errors[link.second, link.plane] = overlap(network, link)
        errors[link.first, link.plane] = np.nan_to_num(errors[link.first, link.plane])
        placed[[link.first, link.second]] = True
    seen = np.any(np.isfinite(errors), axis=0)
    inverse = np.where(seen[:, None], network.inverse_normals, np.nan)
    lengths = np.linalg.norm(inverse, axis=1)
    unit = lengths[np.flatnonzero(seen)[0]]
    return PosesAndPlanes(
        np.where(placed[:, None, None], network.rotations, np.nan),
        np.where(placed[:, None], network.translations * unit, np.nan),
        inverse / lengths[:, None],
        unit / lengths,
        errors,
        locked,
    )
