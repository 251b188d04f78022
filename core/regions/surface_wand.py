"""The surface wand: from one face the region grows over a smooth part of the scan to its creases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import FloatArray, IndexArray
from ..errors import RegionError
from ..settings import RegionSettings
from .robust_fit import SurfaceFit, fit_smooth, plane_through
from .surface_border import refined_border
from .surface_growing import SurfaceLevel, grown_level, part_around
from .surface_index import SurfaceIndex
from .surface_score import shape_score, stability_score

_GROWTH = 1.35  # ratio of neighbouring tolerances
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


@dataclass(frozen=True, eq=False)
class _Chain:
    """Levels found from one first fit, for the first of `tolerances`."""

    start: SurfaceFit
    tolerances: tuple[float, ...]
    levels: tuple[SurfaceLevel, ...]

    @property
    def score(self) -> float:
        """The best level's score."""
        return max((level.score for level in _rated(self.levels)), default=-np.inf)


def grow_surface(index: SurfaceIndex, face: int, settings: RegionSettings | None = None) -> SurfaceClick:
    """Regions around a clicked face for a series of tolerances that starts at the scan's own noise.

    The first surface is fitted to a wide and to a narrow surrounding of the click; the better one goes on.

    Raises
    ------
    RegionError
        The face does not exist, or it is a loose triangle.
    """
    settings = settings or RegionSettings()
    if not 0 <= face < index.face_count:
        raise RegionError("The click is not on the scan.")
    counts = settings.seed_patches, settings.seed_patches // 4
    chains = [_near_chain(index, face, _seed_fit(index, face, count), settings) for count in counts]
    chain = max(chains, key=lambda one: one.score)
    levels = chain.levels
    rest = chain.tolerances[len(levels) :]
    if rest and len(index.patches.area) > _NEAR and not _saturated(levels):
        start = levels[-1].fit if levels else chain.start
        levels += tuple(_levels(index, face, start, rest, len(index.patches.area), settings))
    if not levels:
        raise RegionError(
            "This is a loose triangle without neighbours: click on the surface, or use the brush."
        )
    levels = _rated(levels)
    return SurfaceClick(face, levels, int(np.argmax([level.score for level in levels])))


def _near_chain(index: SurfaceIndex, face: int, start: SurfaceFit, settings: RegionSettings) -> _Chain:
    """Levels from a first fit, as far as the patches nearest to the click tell."""
    first = max(1.3 * index.noise, 0.1 * index.spacing, min(2 * start.sigma, 4 * index.noise))
    tolerances = tuple((first * _GROWTH ** np.arange(settings.surface_levels)).tolist())
    return _Chain(start, tolerances, tuple(_levels(index, face, start, tolerances, _NEAR, settings)))


def _rated(levels: tuple[SurfaceLevel, ...]) -> tuple[SurfaceLevel, ...]:
    """Levels with their score for stability added."""
    areas = [level.area for level in levels]
    return tuple(
        replace(level, score=level.score + stability_score(level.area, larger))
        for level, larger in zip(levels, areas[1:] + areas[-1:], strict=True)
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
) -> list[SurfaceLevel]:
    """Levels among the `limit` patches nearest to a face, up to the first that reaches the border of these.

    Once the region has stopped growing, larger tolerances are not tried.
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
        level = grown_level(index, piece, fit, tolerance, settings)
        if level is None:
            continue
        if away[piece.node[level.patches]].max() > 0.8 * radius:
            break
        fit = level.fit
        score = shape_score(piece, level, index.noise)
        levels.append(replace(level, patches=piece.node[level.patches].astype(np.int64), score=score))
        if _saturated(levels):
            break
    return levels


def _alone(index: SurfaceIndex, face: int) -> bool:
    """Whether a face has no neighbour."""
    return not bool(np.any(index.pair == face))


def _seed_fit(index: SurfaceIndex, face: int, count: int) -> SurfaceFit:
    """Smooth surface through the surroundings of a face, only the clicked side of a thin wall."""
    patches = index.patches
    middle: FloatArray = index.middle[face].astype(np.float64)
    near = np.atleast_1d(patches.tree.query(middle, min(count, len(patches.area)))[1])
    near = near[patches.normal[near] @ index.smooth_normal[face] > 0.3]
    if len(near) >= 8:
        return fit_smooth(patches.middle[near])
    return plane_through(middle, index.normal[face].astype(np.float64))
