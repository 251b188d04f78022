"""Lines and faces on the screen."""

from __future__ import annotations

from collections.abc import Sequence

import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ...core.arrays import FloatArray

WIDTH = 2.0  # pixels
DARK = (0.0, 0.0, 0.0, 0.7)


def draw_loops(
    loops: Sequence[FloatArray], color: Sequence[float], closed: bool = True, width: float = WIDTH
) -> None:
    """Draw polylines (n,2) in region pixels, with a dark rim that shows on any photo."""
    gpu.state.blend_set("ALPHA")
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    for loop in loops:
        if len(loop) < 2:
            continue
        points = np.concatenate([loop, loop[:1]]) if closed else loop
        places = np.column_stack([points, np.zeros(len(points))]).astype(np.float32)
        batch = batch_for_shader(shader, "LINE_STRIP", {"pos": places})
        for thickness, tint in ((width + 2.0, DARK), (width, (*color[:3], 1.0))):
            shader.uniform_float("lineWidth", thickness)
            shader.uniform_float("color", tint)
            batch.draw(shader)
    gpu.state.blend_set("NONE")


def circle(centre: FloatArray, radius: float) -> FloatArray:
    """Closed circle (n,2) around a place in the region."""
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    return centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
