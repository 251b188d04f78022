"""The surface wand: from one face the region grows over a smooth part of the scan to its creases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from heapq import heappop, heappush

import numpy as np

from ...arrays import FloatArray, IndexArray
from ...errors import RegionError
from ...settings import RegionSettings
from .border import refined_border
from .graph import reduced_pairs
from .growing import SurfaceLevel, grown_level, part_around
from .index import SurfaceIndex
from .robust_fit import SurfaceFit, fit_smooth, plane_through
from .score import shape_score, stability_score

_GROWTH = 1.4  # ratio of neighbouring tolerances
_NEAR = 3_000  # patches looked at first; all, when a region reaches the border of these
_SATURATED = 3  # levels in a row
_MORE = 1.01  # growth of the area below which they count as the same


@dataclass(frozen=True, eq=False)
class SurfaceClick:
    """What a click found: `levels` by growing tolerance, and the one the wand would take."""

    face: int
    levels: tuple[SurfaceLevel, ...]
    best: int

    def level(self, steps: int = 0) -> SurfaceLevel:
        """Level `steps` more (or less, negative) tolerant than the best, as far as there are any."""
        return self.levels[min(max(self.best + steps, 0), len(self.levels) - 1)]


def grow_surface(index: SurfaceIndex, face: int, settings: RegionSettings | None = None) -> SurfaceClick:
    """Regions around a clicked face for a series of tolerances that starts at the scan's own noise.

    The first surface is fitted to a wide and to a narrow surrounding of the click, and to what hangs together
    with it over the smallest steps and turns; the best of these goes on.

    Raises
    ------
    RegionError
        The face does not exist, or it is a loose triangle.
    """
    settings = settings or RegionSettings()
    if not 0 <= face < index.face_count:
        raise RegionError("The click is not on the scan.")
    starts = _starts(index, face, settings)
    start = max(starts, key=lambda fit: _promise(index, face, fit, settings))
    tolerances = _tolerances(index, start, settings)
    levels = _levels(index, face, start, tolerances, _NEAR, settings)
    rest = [tolerance for tolerance in tolerances if not levels or tolerance > levels[-1].tolerance]
    if rest and len(index.patches.area) > _NEAR and not _saturated(levels):
        fit = levels[-1].fit if levels else start
        # Large regions take long, and change little from one tolerance to the next.
        levels += _levels(index, face, fit, rest[::2], len(index.patches.area), settings)
    if not levels:
        raise RegionError(
            "This is a loose triangle without neighbours: click on the surface, or use the brush."
        )
    rated = _rated(levels)
    return SurfaceClick(face, rated, int(np.argmax([level.score for level in rated])))


def _tolerances(index: SurfaceIndex, start: SurfaceFit, settings: RegionSettings) -> list[float]:
    """Tolerances (m) to try with a first fit."""
    first = max(1.3 * index.noise, 0.1 * index.spacing, min(2 * start.sigma, 4 * index.noise))
    tolerances: list[float] = (first * _GROWTH ** np.arange(settings.surface_levels)).tolist()
    return tolerances


def _promise(index: SurfaceIndex, face: int, start: SurfaceFit, settings: RegionSettings) -> float:
    """Best score that a first fit leads to, by every second tolerance and the nearest patches."""
    tolerances = _tolerances(index, start, settings)[::2]
    levels = _rated(_levels(index, face, start, tolerances, _NEAR, settings, ornament=False))
    return max((level.score for level in levels), default=-np.inf)


def _rated(levels: Sequence[SurfaceLevel]) -> tuple[SurfaceLevel, ...]:
    """Levels with their score for stability added."""
    areas = [level.area for level in levels]
    return tuple(
        replace(level, score=level.score + stability_score(level.area, larger))
        for level, larger in zip(levels, [*areas[1:], *areas[-1:]], strict=True)
    )


def _saturated(levels: Sequence[SurfaceLevel]) -> bool:
    """Whether the region has stopped growing with the tolerance."""
    return len(levels) > _SATURATED and levels[-1].area < _MORE * levels[-1 - _SATURATED].area


def region_faces(index: SurfaceIndex, face: int, level: SurfaceLevel) -> IndexArray:
    """Faces (n,) of a level, its border exact to the face: sorted numbers; `face` is the clicked one."""
    return np.flatnonzero(refined_border(index, level.patches, level.fit, level.tolerance))


def _levels(
    index: SurfaceIndex,
    face: int,
    fit: SurfaceFit,
    tolerances: Sequence[float],
    limit: int,
    settings: RegionSettings,
    ornament: bool = True,
) -> list[SurfaceLevel]:
    """Levels among the `limit` patches nearest to a face, up to the first that reaches the border of these.

    Once the region has stopped growing, larger tolerances are not tried. Without `ornament` holes stay.
    """
    patches = index.patches
    node = int(patches.label[face])
    away = np.linalg.norm(patches.middle - patches.middle[node], axis=1)
    radius = float(np.partition(away, limit)[limit]) if limit < len(away) else np.inf
    # The first fit is uncertain far from the click.
    close = np.abs(fit.distance(patches.middle)) < 2.0 * tolerances[-1] + settings.tilt * away
    piece = part_around(index, node, close & (away <= radius))
    if len(piece.node) == 1 and _alone(index, face):
        return []
    levels: list[SurfaceLevel] = []
    for tolerance in tolerances:
        level = grown_level(index, piece, fit, tolerance, settings, ornament)
        if level is None:
            continue
        if away[piece.node[level.patches]].max() > 0.8 * radius:
            break
        fit = level.fit
        score = shape_score(piece, level, index.noise, patches.width)
        levels.append(replace(level, patches=piece.node[level.patches].astype(np.int64), score=score))
        if _saturated(levels):
            break
    return levels


def _alone(index: SurfaceIndex, face: int) -> bool:
    """Whether a face has no neighbour."""
    return not bool(np.any(index.pair == face))


def _starts(index: SurfaceIndex, face: int, settings: RegionSettings) -> list[SurfaceFit]:
    """Smooth surfaces through different surroundings of a face."""
    wide, narrow = settings.seed_patches, settings.seed_patches // 4
    fits = [_fit_around(index, face, _nearest(index, face, count)) for count in (wide, narrow)]
    return [*fits, _fit_around(index, face, _smoothest(index, face, narrow))]


def _fit_around(index: SurfaceIndex, face: int, near: IndexArray) -> SurfaceFit:
    """Smooth surface through patches (n,) near a face, only the clicked side of a thin wall."""
    patches = index.patches
    near = near[patches.normal[near] @ index.smooth_normal[face] > 0.3]
    if len(near) >= 8:
        return fit_smooth(patches.middle[near])
    middle: FloatArray = index.middle[face].astype(np.float64)
    return plane_through(middle, index.normal[face].astype(np.float64))


def _nearest(index: SurfaceIndex, face: int, count: int) -> IndexArray:
    """The `count` patches nearest to a face, sorted by number."""
    patches = index.patches
    near = patches.tree.query(index.middle[face], min(count, len(patches.area)))[1]
    return np.sort(np.atleast_1d(near))


def _smoothest(index: SurfaceIndex, face: int, count: int) -> IndexArray:
    """The `count` patches that hang together with a face over the smallest steps and turns."""
    patches = index.patches
    inside = np.zeros(len(patches.area), dtype=np.bool_)
    inside[_nearest(index, face, 6 * count)] = True
    inside[patches.label[face]] = True
    members, pair = reduced_pairs(patches.pair, inside)
    first, second = members[pair[:, 0]], members[pair[:, 1]]
    gap, normals = (
        patches.middle[second] - patches.middle[first],
        patches.normal[first] + patches.normal[second],
    )
    step = 0.5 * np.abs(np.einsum("nk,nk->n", gap, normals)) / patches.width
    turn = 1 - np.einsum("nk,nk->n", patches.normal[first], patches.normal[second])
    beside: list[list[tuple[float, int]]] = [[] for _ in members]
    for (one, other), cost in zip(pair.tolist(), (step + turn).tolist(), strict=True):
        beside[one].append((cost, other))
        beside[other].append((cost, one))
    found: set[int] = set()
    front = [(0.0, int(np.searchsorted(members, patches.label[face])))]
    while front and len(found) < count:
        patch = heappop(front)[1]
        if patch not in found:
            found.add(patch)
            for entry in beside[patch]:
                heappush(front, entry)
    return members[sorted(found)].astype(np.int64)
