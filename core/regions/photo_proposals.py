"""Ready regions of a photo to accept or refuse: frames, openings and areas of like colour.

Nothing here is taken without asking: every proposal carries its score.
"""

from __future__ import annotations

import itertools

import numpy as np

from ..arrays import BoolArray
from ..errors import RegionError
from ..jobs import Job, Progress
from .wand import Level, PhotoWand


def propose_image_regions_job(wand: PhotoWand, count: int = 12, across: int = 7) -> Job[list[Level]]:
    """Frames and closed areas of a photo, best first.

    The wand clicked on a grid, `across` times side to side.
    """
    height, width = wand.image.shape[:2]
    step = width / across
    rows, columns = np.arange(step / 2, height, step).tolist(), np.arange(step / 2, width, step).tolist()
    grid = list(itertools.product(columns, rows))
    camera_size = np.array([width, height])
    found: list[tuple[Level, BoolArray]] = []
    for number, pixel in enumerate(grid):
        yield Progress(number / len(grid), f"Looking for regions: {len(found)}")
        try:
            level = wand.click(pixel).level()
        except RegionError:
            continue
        cut_off = np.any(level.outline < 2) or np.any(level.outline > camera_size - 3)
        if cut_off or level.area < 1e-3 * width * height:
            continue
        mask = wand.mask([level.outline])[::8, ::8]
        rival = [k for k, other in enumerate(found) if _alike(mask, other[1])]
        if not rival:
            found.append((level, mask))
        elif level.score > found[rival[0]][0].score:
            found[rival[0]] = (level, mask)
    return [level for level, _ in sorted(found, key=lambda pair: -pair[0].score)[:count]]


def _alike(first: BoolArray, second: BoolArray) -> bool:
    union = np.count_nonzero(first | second)
    return union > 0 and np.count_nonzero(first & second) > 0.6 * union
