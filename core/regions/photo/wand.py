"""The photo wand: one click gives a region; the tolerance moves through smaller and larger ones.

Pixels are (u, v) of the photo at full resolution; the centre of the top-left pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...arrays import ArrayLike, BoolArray, ByteArray, FloatArray
from ...errors import RegionError
from ...geometry.outlines import fill_loops
from ...geometry.polygons import polygon_areas
from ...jobs import Job, Progress, drain, part
from ...settings import RegionSettings
from . import edges, evidence
from .arches import find_arches
from .choice import expected_overlaps
from .colour import ColourMap, colour_map, grown_loop, grown_loops
from .frames import find_frames
from .lines import LineSet, find_lines_job
from .outline import straightened
from .snap import snap_outline_job, snap_polygon_job

Kind = Literal["auto", "frame", "colour"]

_CUT_OFF = 0.05  # share of an outline on the photo's edge from which the region goes on outside
_SPAN = 0.98  # share of the photo's width or height over which a region goes on on both sides
_BORDER = 2.0  # pixels of the working copy that count as the photo's edge


@dataclass(frozen=True, eq=False)
class Level:
    """One region that the wand offers: closed outline (n,2), area in square pixels, score (higher is better).

    `straight` outlines are polygons of few corners.
    """

    outline: FloatArray
    area: float
    score: float
    straight: bool


@dataclass(frozen=True, eq=False)
class WandClick:
    """What a click found: `levels` by growing area, and the one the wand would take."""

    levels: tuple[Level, ...]
    best: int

    def level(self, steps: int = 0) -> Level:
        """Level `steps` larger (or smaller, negative) than the best, as far as there are any."""
        return self.levels[min(max(self.best + steps, 0), len(self.levels) - 1)]


@dataclass(frozen=True, eq=False)
class PhotoWand:
    """A photo made ready for clicks; see `prepare_wand`."""

    image: ByteArray
    factor: float
    gradient: edges.Gradient
    look: evidence.Look
    ground: ColourMap
    lines: LineSet
    segments: FloatArray
    settings: RegionSettings

    def click(self, pixel: Sequence[float] | FloatArray, kind: Kind = "auto") -> WandClick:
        """Regions around a pixel (u, v) of the photo, at working resolution.

        Raises
        ------
        RegionError
            The click is outside the photo, nothing around it has an outline, or what has one goes on outside.
        """
        point = self._inside(pixel)
        return self._levels(*self.candidates(point, kind), point)

    def candidates(
        self, point: FloatArray, kind: Kind = "auto"
    ) -> tuple[list[FloatArray], evidence.Outlines, BoolArray]:
        """All outlines around a point (2,), in pixels of the working copy: closed loops (n,2).

        With them what of them is judged, and which of them (N,) are frames of straight sides.
        """
        loops: list[FloatArray] = []
        parts: list[evidence.Outlines] = []
        if kind != "colour":
            frames = find_frames(self.lines, point, self.settings.least_support, self.settings.line_limit)
            loops += list(frames.corners)
            parts.append(evidence.outlines_of(frames.corners, frames.support))
            arches = find_arches(self.gradient, self.lines, self.segments, frames.strips, point)
            loops += list(arches.loops)
            parts.append(evidence.outlines_of_arches(arches))
        count = len(loops)
        if kind != "frame":
            loops += grown_loops(self.ground, point)
            parts += [evidence.outline_of_loop(loop) for loop in loops[count:]]
        return loops, evidence.joined_outlines(parts), np.arange(len(loops)) < count

    def grow(self, pixel: Sequence[float] | FloatArray, tolerance: float) -> Level:
        """Region of like colour around a pixel with a given tolerance (Delta E)."""
        loop = grown_loop(self.ground, self._inside(pixel), tolerance)
        area = float(polygon_areas(loop[None])[0])
        return Level(edges.to_full(loop, self.factor), area / self.factor**2, 0.0, False)

    def finished_job(self, level: Level) -> Job[tuple[FloatArray, ...]]:
        """Closed outlines (n,2) of a level, moved onto the edges at full resolution."""
        reach = max(2.0, self.settings.snap_reach / self.factor)
        snap_job = snap_polygon_job if level.straight else snap_outline_job
        return ((yield from snap_job(self.image, level.outline, reach)),)

    def finished(self, level: Level) -> tuple[FloatArray, ...]:
        """Drain `finished_job`."""
        return drain(self.finished_job(level))

    def mask(self, loops: Sequence[FloatArray]) -> BoolArray:
        """Mask (H,W) of closed outlines at full resolution."""
        return fill_loops(loops, self.image.shape[1], self.image.shape[0])

    def _levels(
        self, loops: list[FloatArray], outlines: evidence.Outlines, straight: BoolArray, point: FloatArray
    ) -> WandClick:
        """Offer the best outlines, each unlike the others and whole in the photo."""
        if not loops:
            raise RegionError(
                "Nothing here has a closed outline: draw the region with the polygon or lasso tool."
            )
        score = evidence.scores(self.gradient, self.look, outlines, point, straight)
        score[self.cut_off(outlines)] = -np.inf
        if not np.any(np.isfinite(score)):
            raise RegionError(
                "What is here goes on outside the photo, as sky or a wall does: click a region that "
                "the photo shows whole, or draw it with the polygon or lasso tool."
            )
        expected = expected_overlaps(loops, score, evidence.DOUBT)
        levels = []
        for k in _distinct(outlines, score, expected, self.settings.level_count):
            corners = _corners(loops[k], bool(straight[k]), bool(outlines.arched[k]))
            outline = edges.to_full(loops[k] if corners is None else corners, self.factor)
            area = float(outlines.area[k]) / self.factor**2
            levels.append(Level(outline, area, float(score[k]), corners is not None))
        ordered = sorted(levels, key=lambda level: level.area)
        return WandClick(tuple(ordered), ordered.index(levels[0]))

    def cut_off(self, outlines: evidence.Outlines) -> BoolArray:
        """Whether outlines (N,) run along the photo's edge, or from one edge to the opposite one."""
        height, width = self.gradient.u.shape
        last = np.array([width, height]) - 1 - _BORDER
        outside = np.any((outlines.points < _BORDER) | (outlines.points > last), axis=-1)
        spans = np.any(np.ptp(outlines.points, axis=(1, 2)) > _SPAN * last, axis=-1)
        cut_off: BoolArray = (outside.mean(axis=(1, 2)) > _CUT_OFF) | spans
        return cut_off

    def _inside(self, pixel: Sequence[float] | FloatArray) -> FloatArray:
        point = np.asarray(pixel, dtype=np.float64)
        height, width = self.image.shape[:2]
        if not (
            np.all(np.isfinite(point))
            and -0.5 <= point[0] <= width - 0.5
            and -0.5 <= point[1] <= height - 0.5
        ):
            raise RegionError("The click is outside the photo.")
        return edges.to_reduced(point, self.factor)


def _corners(loop: FloatArray, frame: bool, arched: bool) -> FloatArray | None:
    """Few corners (n,2) between which a loop is straight; else None."""
    if arched:
        return None
    if not frame:
        return straightened(loop)
    return loop[:3] if np.array_equal(loop[3], loop[0]) else loop  # a triangle repeats its first


def _distinct(outlines: evidence.Outlines, score: FloatArray, expected: FloatArray, count: int) -> list[int]:
    """The outline that is most to be expected, then those of best score, each unlike the ones before.

    Unlike is what is somewhere off by 2 % of the size, or 3 pixels.
    """
    kept: list[int] = []
    corners = outlines.points[:, :, [0, -1]].reshape(len(score), -1, 2)
    size = np.maximum(3.0, 0.02 * np.ptp(corners, axis=1).max(axis=1))
    places = corners[..., 0] + 1j * corners[..., 1]
    for k in [int(np.argmax(expected)), *np.argsort(-score, kind="stable").tolist()]:
        if len(kept) == count or not np.isfinite(score[k]):
            break
        gap = np.abs(places[k][None, :, None] - places[kept][:, None])
        if np.all(gap.min(axis=2).max(axis=1) > size[k]):
            kept.append(k)
    return kept


def prepare_wand_job(image: ArrayLike, settings: RegionSettings | None = None) -> Job[PhotoWand]:
    """Make a photo ready for wand clicks: (H,W,3) uint8 RGB -> PhotoWand, which keeps (a view of) the photo.

    Raises RegionError for an image that is not 8 bit.
    """
    settings = settings or RegionSettings()
    photo = edges.as_photo(image)
    yield Progress(0.0, "Reducing the photo")
    small, factor = edges.reduced(photo, settings.working_size)
    yield Progress(0.1, "Reading its colours")
    colours = edges.lab(small)
    even = edges.evened(colours[:, :, :1])  # edges of hue alone are JPEG's noise, or found by colour
    yield Progress(0.2, "Finding edges")
    segments = edges.straight_segments(even)
    yield Progress(0.5, "Finding straight edges")
    lines = yield from part(find_lines_job(segments, small.shape[1], small.shape[0]), 0.5, 1.0)
    gradient = edges.gradient(even)
    look, ground = evidence.look_of(colours, gradient), colour_map(colours, gradient)
    return PhotoWand(photo, factor, gradient, look, ground, lines, segments, settings)


def prepare_wand(image: ArrayLike, settings: RegionSettings | None = None) -> PhotoWand:
    """Drain `prepare_wand_job`."""
    return drain(prepare_wand_job(image, settings))
