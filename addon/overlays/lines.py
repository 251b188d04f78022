"""Lines, dashes, hatching and names on the screen."""

from __future__ import annotations

from collections.abc import Sequence

import blf
import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ...core.arrays import FloatArray

WIDTH = 2.0  # pixels
DARK = (0.0, 0.0, 0.0, 0.7)
_DASH = 7.0  # pixels
_TEXT = 12.0  # points


def draw_loops(
    loops: Sequence[FloatArray], color: Sequence[float], closed: bool = True, width: float = WIDTH
) -> None:
    """Draw polylines (n,2) in region pixels, with a dark rim that shows on any photo."""
    for loop in loops:
        if len(loop) >= 2:
            _draw_lines(np.concatenate([loop, loop[:1]]) if closed else loop, "LINE_STRIP", color, width)


def draw_dashes(loops: Sequence[FloatArray], color: Sequence[float], width: float = WIDTH) -> None:
    """Draw closed polylines (n,2) in region pixels as dashes."""
    for loop in loops:
        if len(loop) >= 2:
            _draw_lines(dashed(loop), "LINES", color, width)


def draw_segments(segments: FloatArray, color: Sequence[float], width: float = 1.0) -> None:
    """Draw single lines (n,2,2) in region pixels."""
    if len(segments):
        _draw_lines(segments.reshape(-1, 2), "LINES", color, width)


def _draw_lines(points: FloatArray, kind: str, color: Sequence[float], width: float) -> None:
    gpu.state.blend_set("ALPHA")
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    shader.bind()
    shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    places = np.column_stack([points, np.zeros(len(points))]).astype(np.float32)
    batch = batch_for_shader(shader, kind, {"pos": places})
    for thickness, tint in ((width + 2.0, DARK), (width, (*color[:3], 1.0))):
        shader.uniform_float("lineWidth", thickness)
        shader.uniform_float("color", tint)
        batch.draw(shader)
    gpu.state.blend_set("NONE")


def dashed(loop: FloatArray, dash: float = _DASH) -> FloatArray:
    """Ends (2n,2) of dashes along a closed polyline (m,2)."""
    closed = np.concatenate([loop, loop[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    count = 2 * max(2, round(float(length[-1]) / (2 * dash)))
    at = np.linspace(0.0, length[-1], count, endpoint=False)
    return np.stack([np.interp(at, length, closed[:, axis]) for axis in (0, 1)], axis=1)


def hatching(loops: Sequence[FloatArray], spacing: float) -> FloatArray:
    """Diagonal lines (n,2,2) inside closed loops (m,2), even-odd, `spacing` apart."""
    starts = np.concatenate(loops)
    ends = np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])
    first, last = starts.sum(axis=1), ends.sum(axis=1)
    lines = []
    for level in np.arange(first.min() + 0.5 * spacing, first.max(), spacing * np.sqrt(2)):
        crossing = (first > level) != (last > level)
        share = (level - first[crossing]) / (last[crossing] - first[crossing])
        met = starts[crossing] + share[:, None] * (ends[crossing] - starts[crossing])
        lines.append(met[np.argsort(met[:, 0])].reshape(-1, 2, 2))
    return np.concatenate(lines) if lines else np.zeros((0, 2, 2))


def circle(centre: FloatArray, radius: float) -> FloatArray:
    """Closed circle (n,2) around a place in the region."""
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    return centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


class Labels:
    """Names to be written, moved down where they would cover another."""

    def __init__(self) -> None:
        self._boxes: list[tuple[float, float, float, float]] = []

    def draw(self, text: str, place: FloatArray, color: Sequence[float]) -> None:
        """Write a text around a place in the region, on a dark ground."""
        font, scale = 0, bpy.context.preferences.system.ui_scale
        blf.size(font, _TEXT * scale)
        width, height = blf.dimensions(font, text)
        x, y, line = float(place[0]) - width / 2, float(place[1]) - height / 2, 1.6 * _TEXT * scale
        while any(self._covers(box, (x, y, width, line)) for box in self._boxes):
            y -= line
        self._boxes.append((x, y, width, line))
        _draw_ground(x - 4 * scale, y - 4 * scale, width + 8 * scale, height + 8 * scale)
        blf.position(font, round(x), round(y), 0)
        blf.color(font, *(0.5 + 0.5 * np.asarray(color[:3], dtype=np.float64)), 1.0)
        blf.draw(font, text)

    @staticmethod
    def _covers(box: tuple[float, float, float, float], other: tuple[float, float, float, float]) -> bool:
        apart = box[0] > other[0] + other[2] + 8 or other[0] > box[0] + box[2] + 8
        return not apart and abs(box[1] - other[1]) < box[3]


def _draw_ground(x: float, y: float, width: float, height: float) -> None:
    corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    shader.bind()
    shader.uniform_float("color", (0.0, 0.0, 0.0, 0.55))
    batch_for_shader(shader, "TRIS", {"pos": corners}, indices=[(0, 1, 2), (0, 2, 3)]).draw(shader)
    gpu.state.blend_set("NONE")
