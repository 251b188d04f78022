"""Straight lines of a photo, and along each which parts an edge really covers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import BoolArray, Float32Array, FloatArray, IndexArray
from ...geometry.runs import runs
from ...jobs import Job, Progress

STEP = 2.0  # pixels between samples along a line
_TOLERANCE = 1.5  # pixels that a segment may lie off its line
_SHORTEST = 14.0  # pixels: shorter segments start no line of their own
_MEMBER = 4.0  # pixels: shorter segments support no line


@dataclass(frozen=True, eq=False)
class LineSet:
    """Lines `normal . x = offset` (x from `centre`) and their support.

    `normal` (N,2), `offset` (N,) pixels; `covered` (N,T) is 1 where an edge covers the line at
    `-reach + STEP * index` along `direction`; `total` (N,T+1) is its running sum in pixels.
    """

    normal: FloatArray
    offset: FloatArray
    covered: Float32Array
    total: FloatArray
    centre: FloatArray
    reach: float

    @property
    def direction(self) -> FloatArray:
        """Unit direction (N,2) of every line, its normal a quarter turn to the right of it in (u, v)."""
        return np.stack([self.normal[:, 1], -self.normal[:, 0]], axis=1)

    def point(self, line: IndexArray, along: FloatArray) -> FloatArray:
        """Points (n,2), from the centre, at positions `along` (n,) of lines (n,)."""
        foot: FloatArray = self.normal[line] * self.offset[line, None]
        return foot + self.direction[line] * along[:, None]

    def sight(self, line: IndexArray, beyond: float = 3.0) -> tuple[FloatArray, FloatArray]:
        """Positions (n,), (n,) between which lines (n,) are in the photo, or `beyond` pixels beside it."""
        foot, way = self.normal[line] * self.offset[line, None], self.direction[line]
        safe: FloatArray = np.where(np.abs(way) > 1e-9, way, 1e-9)
        ends = np.sort([(-self.centre - beyond - foot) / safe, (self.centre + beyond - foot) / safe], axis=0)
        return ends[0].max(axis=1), ends[1].min(axis=1)

    def covered_until(self, line: IndexArray, along: FloatArray) -> FloatArray:
        """Covered length (pixels) of lines (n,) up to positions `along` (n,)."""
        place = np.clip((along + self.reach) / STEP + 0.5, 0, self.total.shape[1] - 1.001)
        lower = place.astype(np.int64)
        low = self.total[line, lower]
        covered: FloatArray = low + (place - lower) * (self.total[line, lower + 1] - low)
        return covered


def find_lines_job(segments: FloatArray, width: int, height: int, limit: int = 2500) -> Job[LineSet]:
    """Join edge segments (N,4) that lie on one line; at most `limit` lines, the longest segments first."""
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    reach = float(np.hypot(width, height)) / 2 + 2 * STEP
    ends = segments.reshape(-1, 2, 2) - centre
    ends = ends[np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > _MEMBER]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    middle = ends.mean(axis=1)
    free = length >= _SHORTEST
    order = np.argsort(-length, kind="stable")
    order = order[free[order]]
    lines: list[tuple[FloatArray, float, Float32Array]] = []
    for number, first in enumerate(order):
        if number % 100 == 0:
            yield Progress(number / len(order), "Finding straight edges")
        if free[first] and len(lines) < limit:
            normal, offset, members = _fit(ends, middle, length, int(first))
            free[members[_along(ends[members], length[members], normal)]] = False
            free[first] = False
            lines.append((normal, offset, _coverage(ends[members], normal, reach)))
    return _line_set(lines, centre, reach)


def _line_set(
    lines: list[tuple[FloatArray, float, Float32Array]], centre: FloatArray, reach: float
) -> LineSet:
    count = int(2 * reach / STEP) + 2
    covered = np.array([line[2] for line in lines], dtype=np.float32).reshape(-1, count)
    total = np.zeros((len(lines), count + 1))
    np.cumsum(covered * STEP, axis=1, out=total[:, 1:])
    normal = np.array([line[0] for line in lines], dtype=np.float64).reshape(-1, 2)
    return LineSet(normal, np.array([line[1] for line in lines]), covered, total, centre, reach)


def _fit(
    ends: FloatArray, middle: FloatArray, length: FloatArray, first: int
) -> tuple[FloatArray, float, IndexArray]:
    """Line through segment `first` and all that lie on it: unit normal, offset, members."""
    towards = (ends[first, 1] - ends[first, 0]) / length[first]
    normal = np.array([-towards[1], towards[0]])
    offset = float(normal @ middle[first])
    members = np.array([first])
    for _ in range(2):
        near = np.flatnonzero(np.abs(middle @ normal - offset) < _TOLERANCE)
        members = near[np.abs(ends[near] @ normal - offset).max(axis=1) < _TOLERANCE]
        members = members if first in members else np.append(members, first)
        weight = length[members]
        centre = weight @ middle[members] / weight.sum()
        apart = ends[members] - centre
        uu, vv, uv = np.einsum("n,nek,nel->kl", weight, apart, apart).ravel()[[0, 3, 1]]
        angle = 0.5 * np.arctan2(2 * uv, uu - vv)  # of the points' longer axis
        normal = np.array([-np.sin(angle), np.cos(angle)])
        offset = float(normal @ centre)
    return normal, offset, members


def _along(ends: FloatArray, length: FloatArray, normal: FloatArray) -> BoolArray:
    across: BoolArray = np.abs((ends[:, 1] - ends[:, 0]) @ normal) < 0.1 * length
    return across


def _coverage(ends: FloatArray, normal: FloatArray, reach: float) -> Float32Array:
    """1 where one of the segments (n,2,2) covers the line, sampled every STEP pixels."""
    along = np.sort(ends @ np.array([normal[1], -normal[0]]), axis=1)
    count = int(2 * reach / STEP) + 2
    index = np.floor((along + reach) / STEP + 0.5).astype(np.int64)
    change = np.bincount(index[:, 0], minlength=count) - np.bincount(index[:, 1], minlength=count)
    covered: Float32Array = (np.cumsum(change) > 0).astype(np.float32)
    return covered


def joined(left: IndexArray, right: IndexArray) -> tuple[IndexArray, IndexArray]:
    """All pairs (x, y) with left[x] == right[y]."""
    order = np.argsort(right, kind="stable")
    ordered = right[order]
    first = np.searchsorted(ordered, left, "left")
    count = np.searchsorted(ordered, left, "right") - first
    x, place = runs(count)
    return x, order[first[x] + place]
