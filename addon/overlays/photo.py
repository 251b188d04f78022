"""Outlines of the marked regions over the photo in the Image Editor."""

from __future__ import annotations

import bpy
import numpy as np

from ...core.arrays import FloatArray
from ...core.regions.outline import mask_polygons
from ..bridge.images import read_mask_pixels
from ..tools.targets import shown_photo, to_region
from .lines import WIDTH, draw_loops

_LIMIT = 60  # outlines kept: those of all photos between which a user goes back and forth


class Outlines:
    """Outlines of mask images, found once per mask: every stroke makes a new mask image."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, int], list[FloatArray]] = {}

    def of(self, image: bpy.types.Image) -> list[FloatArray]:
        """Closed outlines (n,2) of a mask, in its pixels."""
        key = (image.name_full, image.session_uid)
        if key not in self._known:
            if len(self._known) >= _LIMIT:
                self._known.pop(next(iter(self._known)))
            self._known[key] = (
                mask_polygons(read_mask_pixels(image)) if image.has_data or image.size[0] else []
            )
        return self._known[key]

    def clear(self) -> None:
        """Forget all: another file was opened."""
        self._known.clear()


OUTLINES = Outlines()


def draw() -> None:
    """Draw the outlines of the shown photo's regions; the chosen region's is thicker."""
    context = bpy.context
    photo = shown_photo(context)
    if photo is None:
        return
    fresco = context.scene.fresco
    for region in fresco.regions:
        mark = photo.mark(region.uid)
        if mark is None or mark.image is None:
            continue
        size = tuple(mark.image.size)
        loops = [to_region(context, loop, size) for loop in OUTLINES.of(mark.image)]
        chosen = region == fresco.active_region
        draw_loops(loops, np.asarray(region.color), width=WIDTH + (1.5 if chosen else 0.0))
