"""Quadrangles around a click: two lines that face each other across it, and what closes the strip between.

The two long sides of a frieze or a pilaster look wide from its middle; the short ones far away do not, and
many a line looks wider. So two sides are taken from the lines around the click, and the ends from all lines
of the photo that cross the strip between them.
Source: grouping of line segments by proximity, parallelism and collinearity, Lowe, Three-dimensional object
recognition from single two-dimensional images, Artificial Intelligence 1987.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ...arrays import BoolArray, FloatArray, IndexArray
from .lines import LineSet, joined

_STRIPS = 130  # strips that are closed
_WIDE = 0.3  # how much a strip's width (log) counts beside what covers its sides (logs)
_AIMED = 0.07  # standard deviations that a click is off the middle of its region if it is aimed at it
_ANYWHERE = 0.7  # and if it is not
_ASTRAY = 0.02  # density of clicks farther off
CANDIDATE = 0.1  # how much the log odds of the click count while outlines are only gathered
_ENDS = 10  # ends of a strip on either side that are combined
TURN = np.sin(np.radians(15))  # smallest turn at a corner
SHORTEST_SIDE = 8.0  # pixels that a side has at least
_NEAREST = 3.0  # pixels: an end nearer to the click goes through it
_FACING = -np.cos(np.radians(30))  # cosine of the angle between the normals of sides that face each other
_BARE = 0.05  # support that counts for a side that no edge covers
_LEAST_END = 0.1  # support below which a line closes nothing
_WINDOW = 0.75  # of a strip's width, to both sides of the click, that has to be covered
_PER_OCTAVE = 3.0  # distances per octave of which the best end is kept


@dataclass(frozen=True, eq=False)
class Ends:
    """Ends (n,) of strips: `strip` its number, `ahead` of the click or behind, `place` pixels from the click.

    `support` is the share that an edge covers, `first` and `second` (n,2) the corners on the strip's sides.
    """

    strip: IndexArray
    ahead: BoolArray
    place: FloatArray
    support: FloatArray
    first: FloatArray
    second: FloatArray

    def taken(self, which: IndexArray | BoolArray) -> Ends:
        """Some of the ends."""
        return Ends(*(getattr(self, field.name)[which] for field in fields(self)))


@dataclass(frozen=True, eq=False)
class Strips:
    """Pairs of lines on both sides of a click, `first` and `second` (P,), and the ends between them."""

    first: IndexArray
    second: IndexArray
    ends: Ends


def find_strips(lines: LineSet, chosen: IndexArray, point: FloatArray) -> Strips:
    """Strips around a point, from the lines' centre, with their best ends; lines `chosen` (n,) are sides."""
    sides = _facing(lines, chosen, point)
    ends = _ends(lines, sides, point)
    ends = ends.taken(_best_by_distance(ends, _rank(lines, sides, ends, point)))
    return Strips(*sides, ends)


def find_quadrangles(lines: LineSet, strips: Strips, least_support: float) -> tuple[FloatArray, FloatArray]:
    """Quadrangles from strips: corners (N,4,2) from the lines' centre, and the support (N,4) of the sides.

    One side may have less than the least support: ornament, a shadow or something in front can hide it.
    """
    ends = strips.ends
    ahead, behind = np.flatnonzero(ends.ahead), np.flatnonzero(~ends.ahead)
    x, y = joined(ends.strip[ahead], ends.strip[behind])
    far, near = ends.taken(ahead[x]), ends.taken(behind[y])
    corners = np.stack([far.first, far.second, near.second, near.first], axis=1)
    support = np.stack(
        [
            far.support,
            side_support(lines, strips.second[far.strip], far.second, near.second),
            near.support,
            side_support(lines, strips.first[far.strip], far.first, near.first),
        ],
        axis=1,
    )
    good = np.sort(support, axis=1)[:, 1] >= least_support
    return corners[good], np.maximum(support[good], _BARE)


def side_support(lines: LineSet, line: IndexArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Share (n,) of the way between points (n,2) on lines (n,) that an edge covers."""
    direction = lines.direction[line]
    a, b = np.sum(direction * start, axis=-1), np.sum(direction * end, axis=-1)
    covered = np.abs(lines.covered_until(line, b) - lines.covered_until(line, a))
    share: FloatArray = np.clip(covered / np.maximum(np.abs(b - a), 1.0), 0.0, 1.0)
    return share


def _facing(lines: LineSet, chosen: IndexArray, point: FloatArray) -> tuple[IndexArray, IndexArray]:
    """Pairs of lines on both sides of the point, of those that edges cover best around it."""
    away = lines.offset[chosen] - lines.normal[chosen] @ point
    outward, apart = lines.normal[chosen] * np.sign(away)[:, None], np.abs(away)
    i, j = np.nonzero(np.triu(outward @ outward.T < _FACING))
    gap = apart[i] + apart[j]
    rank = _WIDE * np.log(gap)
    foot = np.sum(lines.direction[chosen] * point, axis=1)
    for side in (i, j):
        ends = [lines.covered_until(chosen[side], foot[side] + way * _WINDOW * gap) for way in (-1, 1)]
        rank += np.log(np.maximum((ends[1] - ends[0]) / (2 * _WINDOW * gap), _BARE))
    rank += CANDIDATE * off_centre(
        np.abs(apart[i] - apart[j]) / gap * np.sqrt(3)
    )  # a strip's own is gap / sqrt(12)
    rank[gap < SHORTEST_SIDE] = -np.inf
    best = np.argsort(-rank, kind="stable")[:_STRIPS]
    return chosen[i[best]], chosen[j[best]]


def off_centre(apart: FloatArray) -> FloatArray:
    """Log odds (n,) that a user clicks so many of a region's standard deviations off its middle.

    Half of all clicks are aimed at the middle, the others fall anywhere inside.
    """
    aimed, anywhere = (np.exp(-0.5 * (apart / wide) ** 2) / wide**2 for wide in (_AIMED, _ANYWHERE))
    odds: FloatArray = np.log(aimed + anywhere + _ASTRAY)
    return odds


def _ends(lines: LineSet, strips: tuple[IndexArray, IndexArray], point: FloatArray) -> Ends:
    """All lines that cross a strip in the photo, at some distance from the click, and are covered there."""
    on_first, from_first, met_first = _crossings(lines, strips[0])
    on_second, from_second, met_second = _crossings(lines, strips[1])
    strip, line = np.nonzero(met_first & met_second & (np.abs(from_first - from_second) > SHORTEST_SIDE))
    a, b = from_first[strip, line], from_second[strip, line]
    support = np.abs(lines.covered_until(line, a) - lines.covered_until(line, b)) / np.abs(a - b)
    covered = support >= _LEAST_END
    strip, line, support = strip[covered], line[covered], np.minimum(support[covered], 1.0)
    first, second = (
        lines.point(side[strip], place[strip, line])
        for side, place in ((strips[0], on_first), (strips[1], on_second))
    )
    axis = lines.direction[strips[0][strip]]
    place = np.sum(((first + second) / 2 - point) * axis, axis=1)
    ends = Ends(strip, place > 0, np.abs(place), support, first, second)
    return ends.taken(ends.place > _NEAREST)


def _crossings(lines: LineSet, side: IndexArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Where all lines (n,) cross sides (P,): places (P,n) along the side and the line; where in sight."""
    every = lines.normal.astype(np.float32)  # a thousandth of a pixel is enough, and twice as fast
    normal, offset = every[side], lines.offset[side, None].astype(np.float32)
    cross = normal @ np.stack([every[:, 1], -every[:, 0]])
    cosine = normal @ every.T
    turns = np.abs(cross) > TURN
    inverse = 1 / np.where(turns, cross, np.float32(1))
    offsets = lines.offset.astype(np.float32)
    along_side = (cosine * offset - offsets) * inverse
    along_line = (offset - cosine * offsets) * inverse
    low, high = lines.sight(side)
    met: BoolArray = turns & (along_side >= low[:, None]) & (along_side <= high[:, None])
    return along_side, along_line, met


def _rank(lines: LineSet, strips: tuple[IndexArray, IndexArray], ends: Ends, point: FloatArray) -> FloatArray:
    """How well (n,) an end and the strip's sides up to it are covered: sum of three logs."""
    rank: FloatArray = np.log(np.maximum(ends.support, _BARE))
    for side, corner in zip(strips, (ends.first, ends.second), strict=True):
        rank += np.log(np.maximum(side_support(lines, side[ends.strip], point, corner), _BARE))
    return rank


def _best_by_distance(ends: Ends, rank: FloatArray) -> IndexArray:
    """Of the ends of a strip at about the same distance the best one, and of these the best `_ENDS`."""
    step = np.floor(_PER_OCTAVE * np.log2(ends.place)).astype(np.int64)
    way = ends.strip * 2 + ends.ahead
    order = np.argsort(-rank, kind="stable")
    _, once = np.unique((way * 64 + step)[order], return_index=True)
    order = order[np.sort(once)]
    order = order[np.argsort(way[order], kind="stable")]
    group = way[order]
    number = np.arange(len(order)) - np.searchsorted(group, group, "left")
    best: IndexArray = order[number < _ENDS]
    return best
