"""Straight-sided frames around a click: panels, windows, doors, painted fields, of three or four sides.

Ornamented stone is not of one colour, but what bounds it is straight: among all convex polygons around the
click whose sides lie on lines of the photo, those are kept whose sides an edge really covers.
Source: convex groups by their gap fraction, Jacobs, Robust and efficient detection of salient convex
groups, PAMI 1996; here the support is read off whole lines, so a side may be interrupted by ornament.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import ArrayLike, FloatArray, IndexArray, IntArray
from .lines import STEP, LineSet

_SECTORS = 12  # directions around the click from which lines are taken evenly
_SHORTEST_SIDE = 8.0  # pixels
_TURN = np.sin(np.radians(15))  # smallest turn at a corner
_CONSIDERED = 4000  # frames with the best covered sides whose places are compared
_SPARSE = 4  # samples along a line of which one is enough to tell how wide the line looks
_ALIKE = 0.02  # of a frame's size: corners nearer than this are alike


@dataclass(frozen=True, eq=False)
class _Sides:
    """Sides on line `on` between lines `after` and `before`: `support` 0..1 and `length` pixels, all (S,)."""

    after: IndexArray
    on: IndexArray
    before: IndexArray
    support: FloatArray
    length: FloatArray


def find_frames(
    lines: LineSet, click: ArrayLike, least_support: float, line_limit: int, keep: int = 200
) -> FloatArray:
    """Frames around a click (u, v): corners (N,4,2), N <= `keep`, of which a triangle repeats its first."""
    point = np.asarray(click, dtype=np.float64) - lines.centre
    chosen = _nearby_lines(lines, point, line_limit)
    side = np.where(lines.normal[chosen] @ point > lines.offset[chosen], 1.0, -1.0)
    normal, offset = lines.normal[chosen] * side[:, None], lines.offset[chosen] * side
    corner = _intersections(normal, offset)
    sides = _supported_sides(lines, chosen, side, normal, corner, least_support)
    members = np.concatenate([_triangles(sides, len(chosen)), _quadrangles(sides, len(chosen))])
    if len(members) == 0:
        return np.zeros((0, 4, 2))
    support = np.where(members >= 0, sides.support[members], 1.0)
    covered = np.log(support).mean(axis=1) + support.min(axis=1)
    best = np.argsort(-covered, kind="stable")[:_CONSIDERED]
    members, covered = members[best], covered[best]
    corners = corner[sides.on[members], sides.before[members]]
    corners[members[:, 3] < 0, 3] = corners[members[:, 3] < 0, 0]
    rank = covered + centrality(*polygon_moments(corners), point)
    frames: FloatArray = corners[_unlike(corners, rank)[:keep]] + lines.centre
    return frames


def _unlike(corners: FloatArray, rank: FloatArray) -> IndexArray:
    """Polygons (N,4,2) by falling rank, of those with corners in the same places only the best."""
    first = np.argmin(corners.sum(axis=2), axis=1)
    turned = np.take_along_axis(corners, (np.arange(4) + first[:, None])[..., None] % 4, axis=1)
    size = np.log2(np.maximum(_ALIKE * np.sqrt(polygon_areas(corners)), 3.0))
    place = np.round(turned.reshape(-1, 8) / np.exp2(np.round(size))[:, None]).astype(np.int64)
    order = np.argsort(-rank, kind="stable")
    _, once = np.unique(np.column_stack([np.round(size), place])[order], axis=0, return_index=True)
    unlike: IndexArray = order[np.sort(once)]
    return unlike


def _nearby_lines(lines: LineSet, point: FloatArray, limit: int) -> IndexArray:
    """Lines that cover the largest angles as seen from the point, evenly from all sides."""
    distance = lines.normal @ point - lines.offset
    covered = lines.covered[:, ::_SPARSE]
    along = np.arange(covered.shape[1]) * (STEP * _SPARSE) - lines.reach - (lines.direction @ point)[:, None]
    apart = np.abs(distance)
    angle = np.sum(covered * (apart[:, None] / (apart[:, None] ** 2 + along**2 + 1e-9)), axis=1)
    angle[apart < 3] = 0  # a line through the click bounds nothing
    inward = lines.normal * np.sign(distance)[:, None]
    sector = (
        np.floor((np.arctan2(inward[:, 1], inward[:, 0]) / (2 * np.pi) + 1) * _SECTORS).astype(int) % _SECTORS
    )
    chosen = np.zeros(len(angle), dtype=np.bool_)
    # Mostly lines that look wide from the click; some that are long, however far: the ends of a frieze.
    for rank, share in ((angle, 0.75), (angle * apart, 0.25)):
        free = rank * ~chosen
        order = np.argsort(-free, kind="stable")
        order = order[free[order] > 0]
        for number in range(_SECTORS):
            chosen[order[sector[order] == number][: int(share * limit / _SECTORS)]] = True
    return np.flatnonzero(chosen)


def _intersections(normal: FloatArray, offset: FloatArray) -> FloatArray:
    """Corner (n,n,2) where line i meets line j; NaN where the way around does not turn enough from i to j."""
    cross = normal[:, None, 0] * normal[None, :, 1] - normal[:, None, 1] * normal[None, :, 0]
    safe = np.where(cross > _TURN, cross, np.nan)
    u = (offset[:, None] * normal[None, :, 1] - normal[:, None, 1] * offset[None, :]) / safe
    v = (normal[:, None, 0] * offset[None, :] - offset[:, None] * normal[None, :, 0]) / safe
    return np.stack([u, v], axis=-1)


def _supported_sides(
    lines: LineSet, chosen: IndexArray, side: FloatArray, normal: FloatArray, corner: FloatArray, least: float
) -> _Sides:
    """All sides between two corners in the photo that an edge covers to at least the share `least`."""
    inside = np.all(np.abs(corner) <= lines.centre + 3, axis=-1)
    after, on = np.nonzero(inside)
    first, second = joined(on, after)
    i, j, k = after[first], on[first], on[second]
    direction = np.stack([normal[:, 1], -normal[:, 0]], axis=1)
    start = np.einsum("sk,sk->s", corner[i, j], direction[j])
    end = np.einsum("sk,sk->s", corner[j, k], direction[j])
    long = end - start > _SHORTEST_SIDE
    i, j, k, start, end = i[long], j[long], k[long], start[long], end[long]
    line = chosen[j]
    covered = np.abs(lines.covered_until(line, end * side[j]) - lines.covered_until(line, start * side[j]))
    support = np.minimum(covered / (end - start), 1.0)
    good = support >= least
    return _Sides(i[good], j[good], k[good], support[good], (end - start)[good])


def joined(left: IndexArray, right: IndexArray) -> tuple[IndexArray, IndexArray]:
    """All pairs (x, y) with left[x] == right[y]."""
    order = np.argsort(right, kind="stable")
    ordered = right[order]
    first = np.searchsorted(ordered, left, "left")
    count = np.searchsorted(ordered, left, "right") - first
    x = np.repeat(np.arange(len(left)), count)
    y = order[np.arange(len(x)) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first, count)]
    return x, y


def _table(sides: _Sides, count: int) -> IntArray:
    table = np.full((count, count, count), -1, dtype=np.int32)
    table[sides.after, sides.on, sides.before] = np.arange(len(sides.on))
    return table


def _triangles(sides: _Sides, count: int) -> IndexArray:
    """Sides (n,4) of closed triangles, the fourth -1."""
    table = _table(sides, count)
    second = table[sides.on, sides.before, sides.after]
    third = table[sides.before, sides.after, sides.on]
    once = (second >= 0) & (third >= 0) & (sides.after < sides.on) & (sides.after < sides.before)
    first = np.flatnonzero(once)
    return np.stack([first, second[once], third[once], np.full(len(first), -1)], axis=1)


def _quadrangles(sides: _Sides, count: int) -> IndexArray:
    """Sides (n,4) of closed quadrangles: two opposite sides between the same pair of lines, joined."""
    table = _table(sides, count)
    rising = np.flatnonzero(sides.after < sides.before)
    falling = np.flatnonzero(sides.after > sides.before)
    pair = joined(
        sides.after[rising] * count + sides.before[rising],
        sides.before[falling] * count + sides.after[falling],
    )
    first, third = rising[pair[0]], falling[pair[1]]
    second = table[sides.on[first], sides.before[first], sides.on[third]]
    fourth = table[sides.on[third], sides.after[first], sides.on[first]]
    closed = (second >= 0) & (fourth >= 0)
    quadrangles: IndexArray = np.stack([first, second, third, fourth], axis=1)[closed]
    return quadrangles


def centrality(middle: FloatArray, spread: FloatArray, click: FloatArray) -> FloatArray:
    """Log prior (N,) that a user clicks near the middle of a region: centroids (N,2), covariances (N,2,2).

    The distance from the centroid is measured in the region's own standard deviations; 0.15 of one is
    usual, and beyond twice that the odds fall no faster (Huber).
    """
    off = click - middle
    uu, vv, uv = spread[:, 0, 0], spread[:, 1, 1], spread[:, 0, 1]
    determinant = np.maximum(uu * vv - uv * uv, 1e-9)
    distance2 = (vv * off[:, 0] ** 2 - 2 * uv * off[:, 0] * off[:, 1] + uu * off[:, 1] ** 2) / determinant
    apart = np.sqrt(np.maximum(distance2, 0)) / 0.15
    prior: FloatArray = -0.15 * np.where(apart < 2, apart**2, 4 * apart - 4)
    return prior


def polygon_moments(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centroids (N,2) and covariances (N,2,2) of filled polygons (N,n,2), by Green's theorem."""
    origin = corners.mean(axis=1, keepdims=True)
    a = corners - origin
    b = np.roll(a, -1, axis=1)
    cross = a[..., 0] * b[..., 1] - b[..., 0] * a[..., 1]
    area = cross.sum(axis=1) / 2
    safe = np.where(np.abs(area) > 1e-9, area, 1e-9)
    mean = np.sum((a + b) * cross[..., None], axis=1) / (6 * safe[:, None])
    ab = a[..., :, None] * b[..., None, :]
    second = (
        2 * (a[..., :, None] * a[..., None, :] + b[..., :, None] * b[..., None, :]) + ab + ab.swapaxes(-1, -2)
    )
    spread = np.sum(second * cross[..., None, None], axis=1) / (24 * safe[:, None, None])
    return mean + origin[:, 0], spread - mean[:, :, None] * mean[:, None, :]


def polygon_areas(corners: FloatArray) -> FloatArray:
    """Areas (N,) of polygons (N,n,2)."""
    following = np.roll(corners, -1, axis=1)
    cross = corners[..., 0] * following[..., 1] - following[..., 0] * corners[..., 1]
    areas: FloatArray = np.abs(cross.sum(axis=1)) / 2
    return areas
