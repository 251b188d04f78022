"""Arched outlines around a click: two upright sides, a foot, and a round, pointed or segmental head.

The sides and the foot are strips of straight lines and their ends (`spans`). Every short edge segment between
the sides that belongs to a head tells where that head springs from and how high it rises, by its place and
its slope: they vote. What has most votes on both sides of the middle is moved onto the edges.
Source: Ballard, Generalizing the Hough transform to detect arbitrary shapes, Pattern Recognition 1981.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from ...arrays import AnyArray, BoolArray, Float32Array, FloatArray, IndexArray
from .edges import Gradient
from .lines import LineSet
from .spans import Strips, side_support

_FEET = 24  # strips with one end on which heads are looked for
_ALIKE = 6.0  # pixels: of feet with corners nearer than this one is enough
_UPRIGHT = np.cos(np.radians(60))  # of the angle between the sides and upright in the photo
_WIDE = 0.3  # how much a strip's width (log) counts beside what covers its sides (logs)
_BARE = 0.05  # support that counts for a side that no edge covers
_TILTS = (-0.2, 0.0, 0.2)  # slopes of the springing line against the foot
_SLOPES = np.radians(np.array([-3.0, 3.0], dtype=np.float32))  # how far a segment's direction may be off
_LOWEST, _STEEPEST, _BINS = 0.3, 3.2, 10  # rises of heads in half widths; a semicircle has 1
_SPRING = 0.2  # bins of the springing line's height, in half widths
_SPRINGS = 80  # of these bins
_SHORTEST = 9.0  # pixels: shorter segments have no direction to speak of
_FLAT = 0.12  # of the half width: about the middle a head is level, whatever its rise
_HEADS = 16  # votes per shape that are looked at closely
_ACROSS = np.sin(np.linspace(-1.45, 1.45, 16))  # places along a head, dense where it is steep
_MOVES = (6.0, 4.0, 2.5, 1.5)  # pixels by which heads are moved onto the edges
_CLEAR = 0.06  # gradient of evened lightness above which an edge is no clearer
_COVERED = 0.02  # gradient of evened lightness that is an edge
_LEAST = 0.4  # share of a head that an edge has to cover
HEAD = 25  # corners of a head


@dataclass(frozen=True, eq=False)
class Arches:
    """Arched outlines: `foot` (N,2,2) corners, `head` (N,HEAD,2) from the first side to the second.

    `support` (N,4) is what share of the first side, the head, the second side and the foot edges cover.
    """

    foot: FloatArray
    head: FloatArray
    support: FloatArray

    @property
    def loops(self) -> FloatArray:
        """Closed outlines (N,HEAD+2,2)."""
        closed: FloatArray = np.concatenate([self.foot[:, :1], self.head, self.foot[:, 1:]], axis=1)
        return closed

    def taken(self, which: IndexArray | BoolArray) -> Arches:
        """Some of the arches."""
        return Arches(*(getattr(self, field.name)[which] for field in fields(self)))


@dataclass(frozen=True, eq=False)
class _Feet:
    """Strips with one end (n,): its `corners` (n,2,2), unit ways `up` (n,2,2) along both sides.

    `line` (n,2) numbers the sides, `support` (n,) is what share of the foot edges cover.
    """

    corners: FloatArray
    up: FloatArray
    line: IndexArray
    support: FloatArray

    def taken(self, which: IndexArray) -> _Feet:
        """Some of the feet."""
        return _Feet(*(getattr(self, field.name)[which] for field in fields(self)))


@dataclass(frozen=True, eq=False)
class _Within:
    """Segments (m,) over feet: number of the `foot`, `place` (m,2), `slope` and `length` (m,).

    A place is where between the sides, -1..1, and how high above the foot; all in half widths.
    """

    foot: IndexArray
    place: Float32Array
    slope: Float32Array
    length: Float32Array


def _round(x: AnyArray) -> AnyArray:
    height: AnyArray = np.sqrt(1 - x * x)
    return height


def _pointed(x: AnyArray) -> AnyArray:
    height: AnyArray = np.sqrt((4 - (np.abs(x) + 1) ** 2) / 3)
    return height


def _segmental(x: AnyArray) -> AnyArray:
    height: AnyArray = 1 - x * x
    return height


_Shape = Callable[[AnyArray], AnyArray]
_SHAPES: tuple[_Shape, ...] = (_round, _pointed, _segmental)


def find_arches(
    gradient: Gradient,
    lines: LineSet,
    segments: FloatArray,
    strips: Strips,
    point: FloatArray,
    keep: int = 40,
) -> Arches:
    """Arched outlines around a point (2,), at most `keep`, best covered first.

    `segments` (S,4) are the edge segments of the photo, `strips` those around the point.
    """
    length = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    apart = (segments[length > _SHORTEST].reshape(-1, 2, 2) - lines.centre).astype(np.float32)
    feet = _feet(lines, strips, point - lines.centre)
    parts = []
    within = _within(feet, apart)
    for shape in _SHAPES:
        which, places = _voted(within, len(feet.support), shape)
        parts.append(_fitted(gradient, lines, feet.taken(which), places, shape))
    found = Arches(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Arches)))
    found = found.taken(found.support[:, 1] > _LEAST)
    best = np.argsort(-np.log(np.maximum(found.support, _BARE)).sum(axis=1), kind="stable")
    return found.taken(best[:keep])


def _feet(lines: LineSet, strips: Strips, point: FloatArray) -> _Feet:
    """The ends below the point that are covered best, with their sides."""
    ends = strips.ends
    line = np.stack([strips.first[ends.strip], strips.second[ends.strip]], axis=1)
    corners = np.stack([ends.first, ends.second], axis=1)
    up = lines.direction[line]
    up = up * np.sign(np.sum(up * (point - corners.mean(axis=1))[:, None], axis=2))[..., None]
    rank = np.log(np.maximum(ends.support, _BARE))
    for side in (0, 1):
        share = side_support(
            lines, line[:, side], np.broadcast_to(point, corners[:, side].shape), corners[:, side]
        )
        rank += np.log(np.maximum(share, _BARE))
    rank += _WIDE * np.log(np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1))
    rank[up[..., 1].mean(axis=1) > -_UPRIGHT] = -np.inf
    best = np.argsort(-rank, kind="stable")
    best = best[np.isfinite(rank[best])]
    place = np.round(corners[best].reshape(len(best), 4) / _ALIKE).astype(np.int64)
    best = best[np.sort(np.unique(place, axis=0, return_index=True)[1])][:_FEET]
    return _Feet(corners[best], up[best], line[best], ends.support[best])


def _voted(within: _Within, feet: int, shape: _Shape) -> tuple[IndexArray, FloatArray]:
    """Feet (m,) with heads, and of these (m,3) how high they spring on both sides, and rise: in half widths.

    Votes of the segments left and right of the middle are counted apart: a head has both.
    """
    foot, place, slope, length = within.foot, within.place, within.slope, within.length
    x, y = place[:, 0], place[:, 1]
    fall = (shape(np.clip(x + 0.01, -1, 1)) - shape(np.clip(x - 0.01, -1, 1))) / 0.02
    turned = np.tan(np.arctan(slope) + _SLOPES[:, None])
    votes = np.zeros((2, feet * len(_TILTS) * _BINS * _SPRINGS))
    for number, tilt in enumerate(_TILTS):
        rise = (turned - tilt) / fall
        spring = (y - tilt * x) - rise * shape(x)
        level = np.log(np.maximum(rise, 1e-3) / _LOWEST) / np.log(_STEEPEST / _LOWEST) * _BINS
        good = (level >= 0) & (level < _BINS) & (spring > 0) & (spring < _SPRING * _SPRINGS)
        turn, k = np.nonzero(good)
        at = (foot[k] * len(_TILTS) + number) * _BINS + level[turn, k].astype(np.int64)
        at = at * _SPRINGS + (spring[turn, k] / _SPRING).astype(np.int64)
        for side, there in enumerate((x[k] < 0, x[k] > 0)):
            votes[side] += np.bincount(at[there], length[k[there]], minlength=votes.shape[1])
    return _peaks(votes.reshape(2, feet, len(_TILTS), _BINS, _SPRINGS))


def _peaks(votes: FloatArray) -> tuple[IndexArray, FloatArray]:
    """Feet (m,) and heads (m,3) as in `_voted`, the best per foot.

    From votes (2,feet,tilts,rises,springs) left and right of the middle.
    """
    spread = votes.copy()
    spread[..., 1:] += votes[..., :-1]
    spread[..., :-1] += votes[..., 1:]
    both = spread.min(axis=0)
    flat = both.reshape(len(both), -1 if both.size else 1)
    top = flat.argmax(axis=1)
    turn, level, spring = np.unravel_index(top, both.shape[1:])
    tilt = np.array(_TILTS)[turn]
    rise = _LOWEST * (_STEEPEST / _LOWEST) ** ((level + 0.5) / _BINS)
    high = _SPRING * (spring + 0.5)
    rank = flat[np.arange(len(flat)), top] / (1 + rise)
    best = np.argsort(-rank, kind="stable")[:_HEADS]
    best = best[rank[best] > 0]
    return best, np.stack([high - tilt, high + tilt, rise], axis=1)[best]


def _within(feet: _Feet, segments: Float32Array) -> _Within:
    """Segments (S,2,2) between the sides of feet and above them, as steep there as a head may be."""
    bounds, off, half = _bounds(feet)
    foot, k = np.nonzero(np.all(bounds @ segments.mean(axis=1).T > off, axis=1))
    apart = bounds[foot] @ segments[k].transpose(0, 2, 1) - off[foot]  # (m,3,2)
    x = (apart[:, 0] - apart[:, 1]) / np.maximum(np.abs(apart[:, 0] + apart[:, 1]), 1e-3)
    climb = np.sum(feet.up * bounds[:, 2:], axis=2).astype(np.float32)[foot]
    y = 2 * apart[:, 2] / (half[foot, None] * ((1 - x) * climb[:, :1] + (1 + x) * climb[:, 1:]))
    run, rise = x[:, 1] - x[:, 0], y[:, 1] - y[:, 0]
    place = np.stack([x.mean(axis=1), y.mean(axis=1)], axis=1)
    out = np.abs(place[:, 0])
    good = (out > _FLAT) & (np.abs(run) > 1e-3) & (np.abs(x).max(axis=1) < 1)
    fall = -np.sign(place[:, 0]) * rise / np.where(good, run, 1)
    steepest = np.maximum(0.6 + 1.4 * out, out / np.sqrt(np.maximum(1 - out**2, 1e-3)))
    good &= (fall > _LOWEST * out - 0.25) & (fall < _STEEPEST * steepest + 0.25)
    return _Within(foot[good], place[good], rise[good] / run[good], np.hypot(run[good], rise[good]))


def _bounds(feet: _Feet) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Inward normals (n,3,2) of both sides and the foot, their offsets (n,3,1), half the foot's length."""
    corner, up = feet.corners, feet.up
    base = corner[:, 1] - corner[:, 0]
    ways = np.concatenate([up, base[:, None]], axis=1)
    normal = np.stack([ways[..., 1], -ways[..., 0]], axis=2)
    inward = np.stack([base, -base, up.mean(axis=1)], axis=1)
    normal *= np.sign(np.sum(normal * inward, axis=2))[..., None]
    half = np.linalg.norm(base, axis=1) / 2
    normal[:, 2] /= 2 * half[:, None]
    off = np.sum(normal * corner[:, [0, 1, 0]], axis=2)[..., None]
    return normal.astype(np.float32), off.astype(np.float32), half.astype(np.float32)


def _fitted(gradient: Gradient, lines: LineSet, feet: _Feet, places: FloatArray, shape: _Shape) -> Arches:
    """Arches whose heads (m,3), as in `_voted`, are moved onto the edges, step by step."""
    half = np.linalg.norm(feet.corners[:, 1] - feet.corners[:, 0], axis=1) / 2
    size = places * half[:, None]
    trial = np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    for step in _MOVES:
        tried = size[:, None] + step * trial
        across = _across(gradient, feet, lines.centre, tried, shape)
        clear = np.abs(np.clip(across / _CLEAR, -1, 1).mean(axis=-1))
        size = np.take_along_axis(tried, np.argmax(clear, axis=1)[:, None, None], axis=1)[:, 0]
    across = _across(gradient, feet, lines.centre, size[:, None], shape)[:, 0]
    sign = np.sign(across.mean(axis=1))[:, None]
    spring = feet.corners + size[:, :2, None] * feet.up
    head = _head(feet, size[:, None], np.sin(np.linspace(-np.pi / 2, np.pi / 2, HEAD)), shape)[:, 0]
    support = [side_support(lines, feet.line[:, k], feet.corners[:, k], spring[:, k]) for k in (0, 1)]
    share = (sign * across > _COVERED).mean(axis=1)
    support = np.stack([support[0], share, support[1], feet.support], axis=1)
    return Arches(feet.corners + lines.centre, head + lines.centre, support)


def _head(feet: _Feet, size: FloatArray, x: FloatArray, shape: _Shape) -> FloatArray:
    """Points (m,k,len(x),2) of heads that spring and rise so many pixels (m,k,3)."""
    share = np.stack([(1 - x) / 2, (1 + x) / 2], axis=1)
    spring = feet.corners[:, None] + size[..., :2, None] * feet.up[:, None]
    rising = size[..., 2, None, None] * (share @ feet.up)[:, None] * shape(x)[:, None]
    points: FloatArray = share @ spring + rising
    return points


def _across(
    gradient: Gradient, feet: _Feet, centre: FloatArray, size: FloatArray, shape: _Shape
) -> FloatArray:
    """Gradient (m,k,n) across heads that spring and rise so many pixels (m,k,3)."""
    points = _head(feet, size, _ACROSS, shape)
    way = np.gradient(points, axis=2)
    way /= np.maximum(np.linalg.norm(way, axis=3, keepdims=True), 1e-9)
    found = gradient.at(points + centre)
    across: FloatArray = found[..., 0] * way[..., 1] - found[..., 1] * way[..., 0]
    return across
