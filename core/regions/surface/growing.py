"""Growing a region over patches: those near a smooth surface through the click, refitted until it rests."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import BoolArray, ByteArray, FloatArray, IndexArray, IntArray
from ...settings import RegionSettings
from .graph import component, labelled, reduced_pairs
from .index import SurfaceIndex
from .robust_fit import SurfaceFit, fit_plane, fit_quadric, fit_smooth

_SAMPLE = 300  # points that a fit looks at
_ROUNDS = 3
_FEW = 30  # patches below which a region's outline is too coarse to tell what it encloses
_LONG = 0.5  # extent of an ornament, in sizes of its region, at most
_SAMPLED = 150  # patches that tell whether something enclosed is smooth
_FACET = 20  # patches of something enclosed that may be a region of its own, at least
_SETTLED = 0.01  # share of a region's patches that may change without another round


@dataclass(frozen=True, eq=False)
class SurfaceLevel:
    """A region within `tolerance` m of one smooth surface `fit` (local coordinates of the index).

    `patches` (n,) of the index, `area` m², `score` (higher is better).
    """

    patches: IndexArray
    area: float
    tolerance: float
    score: float
    fit: SurfaceFit


@dataclass(frozen=True, eq=False)
class Part:
    """The patches a click looks at: `node` (n,) sorted, `pair` (m,2) numbers among them, and their data."""

    node: IntArray
    pair: IntArray
    middle: FloatArray
    normal: FloatArray
    area: FloatArray
    rim: BoolArray
    colour: FloatArray | None
    seed: int
    seed_colour: FloatArray


def part_around(index: SurfaceIndex, node: int, close: BoolArray) -> Part:
    """Patches that hang together with patch `node` through close ones (P,)."""
    patches = index.patches
    close = close.copy()
    close[node] = True
    members, pair = reduced_pairs(patches.pair, close)
    label = labelled(pair[:, 0], pair[:, 1], len(members))
    seed = int(np.searchsorted(members, node))
    members, pair = members[label == label[seed]], pair[label[pair[:, 0]] == label[seed]]
    number = np.cumsum(label == label[seed], dtype=np.int32) - 1
    colour = None if patches.colour is None else patches.colour[members]
    return Part(
        members, number[pair], patches.middle[members], patches.normal[members], patches.area[members],
        patches.rim[members], colour, int(number[seed]), _seed_colour(index, node),
    )  # fmt: skip


def _seed_colour(index: SurfaceIndex, node: int) -> FloatArray:
    """Median colour (3,) around the click."""
    patches = index.patches
    if patches.colour is None:
        return np.zeros(3)
    near = np.atleast_1d(patches.tree.query(patches.middle[node], min(9, len(patches.area)))[1])
    near = near[np.linalg.norm(patches.colour[near] - patches.colour[node], axis=1) < 8]
    typical: FloatArray = np.median(patches.colour[near], axis=0)
    return typical


def grown_level(
    index: SurfaceIndex,
    piece: Part,
    fit: SurfaceFit,
    tolerance: float,
    settings: RegionSettings,
    ornament: bool = True,
) -> SurfaceLevel | None:
    """Grow and refit in turn until the region no longer changes; None where nothing agrees.

    Ornament that the region encloses belongs to it, unless told otherwise.
    """
    region, previous = np.zeros(0, dtype=np.int64), -1
    for _ in range(_ROUNDS):
        inside = _agreeing(index, piece, fit, tolerance, settings)
        region = _around(piece, inside)
        if abs(len(region) - previous) <= _SETTLED * len(region):
            break
        previous = len(region)
        if len(region) >= 12:
            step = max(1, len(region) // _SAMPLE)
            fit = fit_smooth(piece.middle[region[::step]], starts=0)
    if len(region) == 0:
        return None
    if ornament and len(region) >= _FEW:
        region = _with_ornament(index, piece, region, fit, tolerance)
    return SurfaceLevel(region, float(piece.area[region].sum()), tolerance, 0.0, fit)


def _agreeing(
    index: SurfaceIndex, piece: Part, fit: SurfaceFit, tolerance: float, settings: RegionSettings
) -> BoolArray:
    """Patches that lie on the fit, turn with it, and have the region's colour.

    Over its own width a patch may leave the surface by twice the tolerance: a narrow one stops at shallow
    steps.
    """
    near: BoolArray = np.abs(fit.distance(piece.middle)) <= tolerance
    slope = min(np.arctan(2 * tolerance / index.patches.width), np.radians(settings.crease_angle))
    turned = np.abs(np.einsum("nk,nk->n", piece.normal, fit.normals(piece.middle)))
    near &= turned >= np.cos(slope)
    if piece.colour is not None and settings.colour_tolerance > 0:
        limit = settings.colour_tolerance + 3 * index.colour_noise
        near &= np.linalg.norm(piece.colour - piece.seed_colour, axis=1) <= limit
    return near


def _around(piece: Part, inside: BoolArray) -> IndexArray:
    """Connected agreeing patches around the seed, or around the agreeing patch next to it."""
    if not inside.any():
        return np.zeros(0, dtype=np.int64)
    seed = piece.seed
    if not inside[seed]:
        members = np.flatnonzero(inside)
        seed = int(members[np.argmin(np.sum((piece.middle[members] - piece.middle[seed]) ** 2, axis=1))])
    return component(piece.pair, inside, seed)


def _with_ornament(
    index: SurfaceIndex, piece: Part, region: IndexArray, fit: SurfaceFit, tolerance: float
) -> IndexArray:
    """Region with what stands out of it or is sunk into it: patches that project into its filled outline.

    Seen along the normal, narrow gaps are closed and enclosed areas filled. What lies deeper than a fifth of
    the region's size (a room behind a window) stays outside, and so does what is long beside the
    region, or smooth: it is a region of its own.
    """
    cell, origin, filled = _filled_outline(piece, region, fit, index.spacing)
    local = (piece.middle - fit.centre) @ fit.axes[:2].T
    place = np.round((local - origin) / cell).astype(np.int64)
    within = np.all((place >= 0) & (place < np.array(filled.shape[::-1])), axis=1)
    within[within] = filled[place[within, 1], place[within, 0]] > 0
    size = float(np.sqrt(piece.area[region].sum()))
    within &= np.abs(fit.distance(piece.middle)) < max(4 * tolerance, 0.2 * size)
    within[region] = False
    members, pair = reduced_pairs(piece.pair, within)
    label = labelled(pair[:, 0], pair[:, 1], len(members))
    roughness = max(2 * index.noise, 1e-3 * size)
    for number in np.flatnonzero(np.bincount(label, minlength=1) >= _FACET):
        enclosed = members[label == number]
        long = float(np.ptp(local[enclosed], axis=0).max()) > _LONG * size
        if long or _smooth(piece.middle[enclosed], piece.area[enclosed], roughness):
            within[enclosed] = False
    within[region] = True
    return component(piece.pair, within, int(region[0]))


def _smooth(points: FloatArray, area: FloatArray, roughness: float) -> bool:
    """Whether enclosed patches (n,3) of `area` (n,) m² scatter by `roughness` (m) about one smooth surface.

    Half of the large ones are enough: the others are the steps around a window, often in slivers.
    """
    large = points[area >= 0.5 * np.quantile(area, 0.9)]
    large = large[:: max(1, len(large) // _SAMPLED)]
    plane = fit_plane(large, share=0.5, starts=4)
    return plane.sigma < roughness or fit_quadric(large, plane).sigma < roughness


def _filled_outline(
    piece: Part, region: IndexArray, fit: SurfaceFit, spacing: float
) -> tuple[float, FloatArray, ByteArray]:
    """Region seen along the normal, gaps closed and holes filled: cell size m, origin (2,), picture (H,W)."""
    local = (piece.middle[region] - fit.centre) @ fit.axes[:2].T
    low, high = local.min(axis=0), local.max(axis=0)
    widest = float(np.sqrt(piece.area[region].max()))
    cell = max(2.0 * spacing, widest, float((high - low).max()) / 700)
    margin = 8
    size = np.ceil((high - low) / cell).astype(int) + 2 * margin + 1
    origin = low - margin * cell
    picture = np.zeros((size[1], size[0]), dtype=np.uint8)
    place = np.round((local - origin) / cell).astype(int)
    picture[place[:, 1], place[:, 0]] = 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    closed = cv2.morphologyEx(picture, cv2.MORPH_CLOSE, disc)
    loops, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, loops, -1, (1,), cv2.FILLED)
    # What only touches the border from inside is the neighbouring wall, not ornament.
    return cell, origin, np.asarray(cv2.erode(picture, np.ones((3, 3), np.uint8)), dtype=np.uint8)
