"""Ready regions of a photo to accept or refuse: frames, openings and areas of like colour.

Nothing here is taken without asking: every proposal carries its score.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from ...arrays import BoolArray, FloatArray
from ...errors import RegionError
from ...geometry.outlines import fill_loops
from ...geometry.polygons import polygon_moments
from ...jobs import Job, Progress
from .edges import to_reduced
from .wand import Level, PhotoWand

_ROUNDS = 2  # clicks per place: the first on the grid, the next in the middle of what that found
_LEAST = 1e-3  # of the photo's area
_GRID = 800  # pixels of the longer side at which regions are compared


def propose_image_regions_job(wand: PhotoWand, count: int = 12, across: int = 7) -> Job[list[Level]]:
    """Frames, openings and closed areas of a photo, best first; none overlap by more than 60 %.

    The wand clicked on a grid, `across` times side to side, and again in the middle of what it found: a
    region is the one that a user would get who clicks on it.
    """
    height, width = wand.image.shape[:2]
    step = width / across
    rows, columns = np.arange(step / 2, height, step).tolist(), np.arange(step / 2, width, step).tolist()
    grid = list(itertools.product(columns, rows))
    factor = min(1.0, _GRID / max(width, height))
    found: list[tuple[Level, BoolArray]] = []
    for number, pixel in enumerate(grid):
        level: Level | None = None
        for repeat in range(_ROUNDS):
            yield Progress((number + repeat / _ROUNDS) / len(grid), f"Looking for regions: {len(found)}")
            level = _clicked(wand, pixel if level is None else _middle(level))
            if level is None:
                break
        if level is not None and level.area > _LEAST * width * height:
            small = max(1, round(width * factor)), max(1, round(height * factor))
            _enter(found, level, fill_loops([to_reduced(level.outline, factor)], *small))
    return [level for level, _ in sorted(found, key=lambda pair: -pair[0].score)[:count]]


def _clicked(wand: PhotoWand, pixel: Sequence[float] | FloatArray) -> Level | None:
    try:
        return wand.click(pixel).level()
    except RegionError:  # nothing here, or it goes on outside the photo
        return None


def _middle(level: Level) -> FloatArray:
    mean: FloatArray = polygon_moments(level.outline[None])[0][0]
    return mean


def _enter(found: list[tuple[Level, BoolArray]], level: Level, mask: BoolArray) -> None:
    """Add a region, or let it take the place of like ones that score less."""
    rivals = [k for k, (_, other) in enumerate(found) if _alike(mask, other)]
    if any(found[k][0].score >= level.score for k in rivals):
        return
    for k in reversed(rivals):
        del found[k]
    found.append((level, mask))


def _alike(first: BoolArray, second: BoolArray) -> bool:
    union = np.count_nonzero(first | second)
    return union > 0 and np.count_nonzero(first & second) > 0.6 * union
