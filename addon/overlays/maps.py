"""The legend of a map in the 3D view."""

from __future__ import annotations

import blf
import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ..bridge.maps import COLOURS, read_legend

MARGIN, LINE, BAR, SWATCH = 24, 18, 220, 12  # pixels
_MOST = 16  # entries shown


def draw() -> None:
    """Draw the legend while the view shows the map's colours."""
    context = bpy.context
    space, scan = context.space_data, context.scene.fresco.scan
    if space is None or scan is None or space.shading.color_type != "VERTEX" or space.shading.type != "SOLID":
        return
    active = scan.data.color_attributes.active_color
    legend = read_legend(context.scene)
    if legend is None or active is None or active.name != COLOURS:
        return
    scale = context.preferences.system.ui_scale
    x, y = MARGIN * scale, MARGIN * scale
    entries = legend["entries"][:_MOST]
    for colour, text in reversed(entries):
        _rectangles([(x, y, SWATCH * scale, SWATCH * scale)], [colour])
        draw_text(x + 1.6 * SWATCH * scale, y + 1, text, scale)
        y += LINE * scale
    if legend["scale"]:
        y += 0.4 * LINE * scale
        width = BAR * scale / len(legend["scale"])
        boxes = [(x + n * width, y, width, SWATCH * scale) for n in range(len(legend["scale"]))]
        _rectangles(boxes, legend["scale"])
        draw_text(x, y + 1.4 * SWATCH * scale, legend["ends"][0], scale)
        draw_text(x + BAR * scale + 8, y + 1, legend["ends"][1], scale)
        y += 2.2 * LINE * scale
    draw_text(x, y + 2, legend["title"], 1.15 * scale)


def _rectangles(boxes: list[tuple[float, float, float, float]], colours: list[list[float]]) -> None:
    """Fill rectangles (x, y, width, height) in region pixels with sRGB colours."""
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    for (x, y, width, height), colour in zip(boxes, colours, strict=True):
        corners = np.array([(x, y), (x + width, y), (x, y + height), (x + width, y + height)], np.float32)
        shader.bind()
        shader.uniform_float("color", (*colour, 1.0))
        batch_for_shader(shader, "TRI_STRIP", {"pos": corners}).draw(shader)


def draw_text(x: float, y: float, text: str, scale: float) -> None:
    """Write at a place of the region, in pixels, readable on any ground."""
    blf.size(0, 12 * scale)
    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 3, 0.0, 0.0, 0.0, 1.0)
    blf.color(0, 1.0, 1.0, 1.0, 1.0)
    blf.position(0, x, y, 0)
    blf.draw(0, text)
    blf.disable(0, blf.SHADOW)
