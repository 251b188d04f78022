"""The photo wand: one click gives a region; the tolerance moves through smaller and larger ones.

Pixels are (u, v) of the photo at full resolution; the centre of the top-left pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..arrays import ArrayLike, BoolArray, ByteArray, Float32Array, FloatArray
from ..errors import RegionError
from ..geometry.outlines import fill_loops
from ..jobs import Job, Progress, drain, part
from ..settings import RegionSettings
from . import colour, edges, frames
from .lines import LineSet, find_lines_job
from .outline import mask_polygons, smoothed_mask
from .snap import snap_outline, snap_polygon

Kind = Literal["auto", "frame", "colour"]

_COLOUR_PENALTY = -0.3
"""Log odds against a region of like colour where a straight frame explains the photo as well."""


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
    colours: Float32Array
    gradient: edges.Gradient
    lines: LineSet
    settings: RegionSettings

    def click(self, pixel: Sequence[float] | FloatArray, kind: Kind = "auto") -> WandClick:
        """Regions around a pixel (u, v) of the photo, at working resolution.

        Raises
        ------
        RegionError
            The click is outside the photo, or there is nothing around it that has an outline.
        """
        point = self._inside(pixel)
        levels: list[Level] = []
        if kind != "colour":
            levels += self._frame_levels(point)
        if kind != "frame":
            levels += self._colour_levels(point)
        if not levels:
            raise RegionError(
                "Nothing here has a closed outline: draw the region with the polygon or lasso tool."
            )
        return _sorted_levels(levels)

    def grow(self, pixel: Sequence[float] | FloatArray, tolerance: float) -> Level:
        """Region of like colour around a pixel with a given tolerance (Delta E)."""
        point = self._inside(pixel)
        click = colour.as_click((point[0], point[1]), self.colours.astype(np.uint8))
        distance = colour.colour_distance(self.colours, self.gradient, click)
        return self._colour_level(
            colour.Growth(colour.grown(distance, click, tolerance), tolerance, 0.0), click
        )

    def finished(self, level: Level) -> tuple[FloatArray, ...]:
        """Closed outlines (n,2) of a level, moved onto the edges at full resolution."""
        reach = max(2.0, self.settings.snap_reach / self.factor)
        snap = snap_polygon if level.straight else snap_outline
        return (snap(self.image, level.outline, reach),)

    def mask(self, loops: Sequence[FloatArray]) -> BoolArray:
        """Mask (H,W) of closed outlines at full resolution."""
        return fill_loops(loops, self.image.shape[1], self.image.shape[0])

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

    def _frame_levels(self, point: FloatArray) -> list[Level]:
        found = frames.find_frames(
            self.lines, self.gradient, point, self.settings.least_support, self.settings.line_limit
        )
        levels = []
        areas = frames.polygon_areas(found.corners)
        score = found.score + self._size_prior(areas)
        for k in _distinct(found.corners, score, self.settings.level_count):
            corners = _without_repeat(found.corners[k])
            outline = edges.to_full(corners, self.factor)
            levels.append(Level(outline, float(areas[k]) / self.factor**2, float(score[k]), True))
        return levels

    def _colour_levels(self, point: FloatArray) -> list[Level]:
        click = colour.as_click((point[0], point[1]), self.colours.astype(np.uint8))
        distance = colour.colour_distance(self.colours, self.gradient, click)
        return [self._colour_level(g, click) for g in colour.best_growth(distance, self.gradient, click, 16)]

    def _colour_level(self, growth: colour.Growth, click: tuple[int, int]) -> Level:
        area = float(np.count_nonzero(growth.mask)) / self.factor**2
        loops = mask_polygons(smoothed_mask(growth.mask, 1.0), 0.5) or mask_polygons(growth.mask, 0.5)
        largest = max(loops, key=lambda loop: float(np.ptp(loop[:, 0]) * np.ptp(loop[:, 1])))
        pixels = np.array([area * self.factor**2])
        middle = frames.centrality(largest[None], np.array(click, dtype=np.float64))
        score = growth.score + float(middle[0] + self._size_prior(pixels)[0]) + _COLOUR_PENALTY
        return Level(edges.to_full(largest, self.factor), area, score, False)

    def _size_prior(self, areas: FloatArray) -> FloatArray:
        """Log prior of areas (N,) in working pixels: the innermost of like frames, but nothing tiny."""
        least = 0.002 * self.colours.shape[0] * self.colours.shape[1]
        size = np.log2(np.maximum(areas, 1.0))
        prior: FloatArray = -0.05 * size - 0.4 * np.maximum(np.log2(least) - size, 0.0)
        return prior


def _without_repeat(corners: FloatArray) -> FloatArray:
    return corners[:3] if np.array_equal(corners[3], corners[0]) else corners


def _distinct(corners: FloatArray, score: FloatArray, count: int) -> list[int]:
    """The best polygons, each unlike the better ones: some corner is off by 2 % of the size, or 3 pixels."""
    kept: list[int] = []
    for k in np.argsort(-score, kind="stable").tolist():
        size = max(3.0, 0.02 * float(np.ptp(corners[k], axis=0).max()))
        gap = [
            np.linalg.norm(corners[k][:, None] - corners[q][None], axis=-1).min(axis=1).max() for q in kept
        ]
        if all(g > size for g in gap):
            kept.append(k)
        if len(kept) == count:
            break
    return kept


def _sorted_levels(levels: list[Level]) -> WandClick:
    best = max(levels, key=lambda level: level.score)
    ordered = sorted(levels, key=lambda level: level.area)
    return WandClick(tuple(ordered), next(k for k, level in enumerate(ordered) if level is best))


def prepare_wand_job(image: ArrayLike, settings: RegionSettings | None = None) -> Job[PhotoWand]:
    """Make a photo ready for wand clicks: (H,W,3) uint8 RGB -> PhotoWand, which keeps (a view of) the photo.

    Raises RegionError for an image that is not 8 bit.
    """
    settings = settings or RegionSettings()
    photo = edges.as_photo(image)
    yield Progress(0.0, "Reducing the photo")
    small, factor = edges.reduced(photo, settings.working_size)
    colours = edges.lab(small)
    even = edges.evened(colours[:, :, :1])  # edges of hue alone are JPEG's noise, or found by colour
    yield Progress(0.2, "Finding edges")
    segments = edges.straight_segments(even)
    yield Progress(0.5, "Finding straight edges")
    lines = yield from part(find_lines_job(segments, small.shape[1], small.shape[0]), 0.5, 1.0)
    return PhotoWand(photo, factor, colours, edges.gradient(even), lines, settings)


def prepare_wand(image: ArrayLike, settings: RegionSettings | None = None) -> PhotoWand:
    """Drain `prepare_wand_job`."""
    return drain(prepare_wand_job(image, settings))
