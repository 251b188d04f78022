"""The surface wand: from one face the region grows over a smooth patch of the scan to its creases.

Boundaries.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..arrays import BoolArray, ByteArray, FloatArray, IndexArray, IntArray
from ..errors import RegionError
from ..settings import RegionSettings
from .robust_fit import SurfaceFit, fit_smooth, plane_through
from .surface_index import SurfaceIndex, SurfacePatches, component, reduced_pairs

_GROWTH = 1.35  # ratio of neighbouring tolerances
_SAMPLE = 1200  # points that a fit looks at
_ROUNDS = 5
_LIMITS = (8_000, 60_000)  # patches looked at first, and when the region reaches their border
_FEW = 30  # patches below which a region's outline is too coarse to tell what it encloses
_BORDER_ANGLE = 40.0  # degrees at which a face at the region's border belongs to what lies beyond


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
class SurfaceClick:
    """What a click found: `levels` by growing tolerance, and the one the wand would take."""

    face: int
    levels: tuple[SurfaceLevel, ...]
    best: int

    def level(self, steps: int = 0) -> SurfaceLevel:
        """Level `steps` more (or less, negative) tolerant than the best, as far as there are any."""
        return self.levels[min(max(self.best + steps, 0), len(self.levels) - 1)]


@dataclass(frozen=True, eq=False)
class _Part:
    """The patches a click looks at: `node` (n,) sorted, `pair` (m,2) numbers among them, and their data."""

    node: IntArray
    pair: IntArray
    middle: FloatArray
    normal: FloatArray
    area: FloatArray
    rim: BoolArray
    colour: FloatArray | None
    seed_colour: FloatArray


def grow_surface(index: SurfaceIndex, face: int, settings: RegionSettings | None = None) -> SurfaceClick:
    """Regions around a clicked face for a series of tolerances that starts at the scan's own noise.

    Raises
    ------
    RegionError
        The face does not exist, or it is a loose triangle.
    """
    settings = settings or RegionSettings()
    if not 0 <= face < index.face_count:
        raise RegionError("The click is not on the scan.")
    start = _seed_fit(index, face, settings)
    for limit in (*_LIMITS, len(index.patches.area)):
        click, reach, radius = _grown_within(index, face, start, limit, settings)
        if reach < 0.8 * radius or limit >= len(index.patches.area):
            break  # nothing was cut off
    return click


def _grown_within(
    index: SurfaceIndex, face: int, start: SurfaceFit, limit: int, settings: RegionSettings
) -> tuple[SurfaceClick, float, float]:
    """Levels among the `limit` patches nearest to a face; how far (m) the best reaches, and these do."""
    patches = index.patches
    node = int(patches.label[face])
    count = min(limit, len(patches.area))
    radius = np.inf
    if count < len(patches.area):
        radius = float(np.asarray(patches.tree.query(patches.middle[node], [count])[0])[0])
    first = max(2.0 * index.noise, 0.1 * index.spacing, start.sigma)
    tolerances = first * _GROWTH ** np.arange(settings.surface_levels)
    piece = _part(patches, node, start, 2.0 * float(tolerances[-1]), radius, settings)
    seed = int(np.searchsorted(piece.node, node))
    levels, fit = [], start
    for tolerance in tolerances:
        level = _level(index, piece, seed, fit, float(tolerance), settings)
        if level is not None:
            levels.append(level)
            fit = level.fit
    if not levels:
        raise RegionError(
            "This is a loose triangle without neighbours: click on the surface, or use the brush."
        )
    scores = [_score(piece, levels, k, seed) for k in range(len(levels))]
    best = int(np.argmax(scores[:-1] or scores))  # how stable the last one is nobody knows
    far = np.linalg.norm(piece.middle[levels[best].patches] - piece.middle[seed], axis=1).max()
    rated = tuple(
        replace(level, patches=piece.node[level.patches].astype(np.int64), score=score)
        for level, score in zip(levels, scores, strict=True)
    )
    return SurfaceClick(face, rated, best), float(far), radius


def region_faces(index: SurfaceIndex, face: int, level: SurfaceLevel) -> IndexArray:
    """Faces (n,) of a level, its border exact to the face: sorted numbers."""
    patches = index.patches
    chosen = np.zeros(len(patches.area), dtype=np.bool_)
    chosen[level.patches] = True
    crossing = patches.pair[chosen[patches.pair[:, 0]] != chosen[patches.pair[:, 1]]]
    border = np.zeros(len(chosen), dtype=np.bool_)
    border[crossing] = True
    inside = chosen[patches.label]
    doubtful = np.flatnonzero(border[patches.label])
    middle = index.middle[doubtful].astype(np.float64)
    near = np.abs(level.fit.distance(middle)) <= level.tolerance
    turned = np.abs(np.sum(index.normal[doubtful] * level.fit.normals(middle), axis=1))
    inside[doubtful] = near & (turned > np.cos(np.radians(_BORDER_ANGLE)))
    return component(index.pair, inside, face) if inside[face] else np.flatnonzero(inside)


def _seed_fit(index: SurfaceIndex, face: int, settings: RegionSettings) -> SurfaceFit:
    """Smooth surface through the surroundings of a face, only the clicked side of a thin wall."""
    patches = index.patches
    count = min(settings.seed_patches, len(patches.area))
    near = np.atleast_1d(patches.tree.query(index.middle[face].astype(np.float64), count)[1])
    near = near[patches.normal[near] @ index.smooth_normal[face] > 0.3]
    if len(near) >= 12:
        return fit_smooth(patches.middle[near])
    return plane_through(index.middle[face].astype(np.float64), index.normal[face].astype(np.float64))


def _part(
    patches: SurfacePatches, node: int, fit: SurfaceFit, depth: float, radius: float, settings: RegionSettings
) -> _Part:
    """Patches near the seed's surface, as far as they hang together."""
    reach = np.linalg.norm(patches.middle - patches.middle[node], axis=1)
    close = reach <= radius
    close &= (
        np.abs(fit.distance(patches.middle)) < depth + settings.tilt * reach
    )  # the first fit is uncertain
    close[node] = True
    inside = np.zeros(len(close), dtype=np.bool_)
    inside[component(patches.pair, close, node)] = True
    members, pair = reduced_pairs(patches.pair, inside)
    colour = None if patches.colour is None else patches.colour[members]
    return _Part(
        members, pair, patches.middle[members], patches.normal[members], patches.area[members],
        patches.rim[members], colour, _seed_colour(patches, node),
    )  # fmt: skip


def _seed_colour(patches: SurfacePatches, node: int) -> FloatArray:
    """Median colour (3,) around the click."""
    if patches.colour is None:
        return np.zeros(3)
    near = np.atleast_1d(patches.tree.query(patches.middle[node], min(9, len(patches.area)))[1])
    typical: FloatArray = np.median(patches.colour[near], axis=0)
    return typical


def _level(
    index: SurfaceIndex, piece: _Part, seed: int, fit: SurfaceFit, tolerance: float, settings: RegionSettings
) -> SurfaceLevel | None:
    """Grow and refit in turn until the region no longer changes."""
    region, previous = np.zeros(0, dtype=np.int64), -1
    for _ in range(_ROUNDS):
        inside = _agreeing(index, piece, fit, tolerance, settings)
        region = _around(piece, inside, seed)
        if abs(len(region) - previous) <= 0.005 * len(region):
            break
        previous = len(region)
        if len(region) >= 12:
            step = max(1, len(region) // _SAMPLE)
            fit = fit_smooth(piece.middle[region[::step]], starts=0)
    if len(region) == 0 or (len(piece.node) == 1 and len(index.pair) == 0):
        return None
    region = _with_ornament(piece, region, fit, tolerance, index.spacing)
    return SurfaceLevel(region, float(piece.area[region].sum()), tolerance, 0.0, fit)


def _agreeing(
    index: SurfaceIndex, piece: _Part, fit: SurfaceFit, tolerance: float, settings: RegionSettings
) -> BoolArray:
    """Patches that lie on the fit, turn with it, and have the region's colour."""
    near = np.abs(fit.distance(piece.middle)) <= tolerance
    turned = np.abs(np.sum(piece.normal * fit.normals(piece.middle), axis=1))
    inside: BoolArray = near & (turned >= np.cos(np.radians(settings.crease_angle)))
    if piece.colour is not None and settings.colour_tolerance > 0:
        limit = settings.colour_tolerance + 3 * index.colour_noise
        inside &= np.linalg.norm(piece.colour - piece.seed_colour, axis=1) <= limit
    return inside


def _around(piece: _Part, inside: BoolArray, seed: int) -> IndexArray:
    """Connected agreeing patches around the seed, or around the agreeing patch next to it."""
    if not inside.any():
        return np.zeros(0, dtype=np.int64)
    if not inside[seed]:
        members = np.flatnonzero(inside)
        seed = int(members[np.argmin(np.sum((piece.middle[members] - piece.middle[seed]) ** 2, axis=1))])
    return component(piece.pair, inside, seed)


def _with_ornament(
    piece: _Part, region: IndexArray, fit: SurfaceFit, tolerance: float, spacing: float
) -> IndexArray:
    """Region with what stands out of it or is sunk into it: patches that project into its filled outline.

    Seen along the normal, narrow gaps are closed and enclosed areas filled; what lies deeper than a fifth
    of the region's size (a room behind a window) stays outside.
    """
    if len(region) < _FEW:
        return region
    cell, origin, filled = _filled_outline(piece, region, fit, spacing)
    local = (piece.middle - fit.centre) @ fit.axes[:2].T
    place = np.round((local - origin) / cell).astype(np.int64)
    within = np.all((place >= 0) & (place < np.array(filled.shape[::-1])), axis=1)
    within[within] = filled[place[within, 1], place[within, 0]] > 0
    depth = max(4 * tolerance, 0.2 * float(np.sqrt(piece.area[region].sum())))
    within &= np.abs(fit.distance(piece.middle)) < depth
    within[region] = True
    return component(piece.pair, within, int(region[0]))


def _filled_outline(
    piece: _Part, region: IndexArray, fit: SurfaceFit, spacing: float
) -> tuple[float, FloatArray, ByteArray]:
    """Region seen along the normal, gaps closed and holes filled: cell size m, origin (2,), picture (H,W)."""
    local = (piece.middle[region] - fit.centre) @ fit.axes[:2].T
    low, high = local.min(axis=0), local.max(axis=0)
    widest = float(np.sqrt(piece.area[region].max()))
    cell = max(2.0 * spacing, widest, float((high - low).max()) / 1000)
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


def _score(piece: _Part, levels: list[SurfaceLevel], k: int, seed: int) -> float:
    """Log score: stable against the tolerance.

    Thin for its size, bounded by creases, solid, around the click.
    """
    level = levels[k]
    larger = levels[min(k + 1, len(levels) - 1)].area
    stability = min(level.area, larger) / max(level.area, larger, 1e-300)
    plane = (piece.middle[level.patches] - level.fit.centre) @ level.fit.axes[:2].T
    if len(plane) < 4:
        return float(np.log(stability))
    hull = float(cv2.contourArea(cv2.convexHull(plane.astype(np.float32))))
    flat = float(np.sum(piece.area[level.patches] * np.abs(piece.normal[level.patches] @ level.fit.normal)))
    solidity = min(1.0, flat / max(hull, 1e-12))
    off = (piece.middle[seed] - level.fit.centre) @ level.fit.axes[:2].T - plane.mean(axis=0)
    spread = np.cov(plane.T) + 1e-12 * np.eye(2)
    central = -0.15 * min(float(off @ np.linalg.solve(spread, off)) / 0.15**2, 9.0)
    crisp = max(_crispness(piece, level), 1e-3)
    flatness = max(1 - 4 * level.tolerance / float(np.sqrt(level.area)), 0.05)
    return float(
        2 * np.log(max(stability, 1e-3))
        + 2 * np.log(max(solidity, 1e-3))
        + np.log(crisp * flatness)
        + central
    )


def _crispness(piece: _Part, level: SurfaceLevel) -> float:
    """Share of the region's border where the surface beyond turns away, or ends."""
    inside = np.zeros(len(piece.node), dtype=np.bool_)
    inside[level.patches] = True
    pair = piece.pair[inside[piece.pair[:, 0]] != inside[piece.pair[:, 1]]]
    beyond = np.where(inside[pair[:, 0]], pair[:, 1], pair[:, 0])
    ends = int(np.count_nonzero(inside & piece.rim))
    if len(beyond) + ends == 0:
        return 1.0
    turned = np.abs(np.sum(piece.normal[beyond] * level.fit.normals(piece.middle[beyond]), axis=1))
    return (int(np.count_nonzero(turned < np.cos(np.radians(25)))) + ends) / (len(beyond) + ends)
