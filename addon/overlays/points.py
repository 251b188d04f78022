"""Picked points over the photo in the Image Editor, with their residuals."""

from __future__ import annotations

import bpy
import numpy as np

from ..tools.targets import shown_photo, to_region
from .lines import draw_loops
from .maps import draw_text
from .residuals import draw_segments

ARM = 9.0  # pixels
GOOD, WRONG, UNKNOWN = (0.2, 1.0, 0.3), (1.0, 0.25, 0.2), (1.0, 0.9, 0.1)


def draw() -> None:
    """Draw a cross, the name and the enlarged residual of every point picked in the shown photo."""
    context = bpy.context
    photo = shown_photo(context)
    if photo is None or not photo.camera_json or not photo.picks:
        return
    compare = context.scene.fresco.compare
    chosen = context.scene.fresco.active_point
    for pick in photo.picks:
        pixel = np.array([pick.pixel[:]])
        place = to_region(context, pixel, photo.size)[0]
        color = UNKNOWN if pick.residual < 0 else GOOD if pick.used else WRONG
        color = color if pick.active else (0.5, 0.5, 0.5)
        width = 3.0 if chosen is not None and chosen.name == pick.name else 1.5
        arms = [place + np.array(ends) * ARM for ends in (((-1, 0), (1, 0)), ((0, -1), (0, 1)))]
        draw_loops(arms, color, closed=False, width=width)
        draw_text(place[0] + ARM, place[1] + ARM / 2, pick.name, 1.0)
        if pick.residual >= 0 and compare.residuals:
            end = pixel - compare.scale * np.array([pick.offset[:]])
            line = to_region(context, np.concatenate([pixel, end]), photo.size)
            draw_segments(line[None], color, 2.0)
