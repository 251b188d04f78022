"""Straight-sided frames around a click: panels, windows, doors, painted fields, of three or four sides.

Ornamented stone is not of one colour, but what bounds it is straight: among the convex polygons around the
click whose sides lie on lines of the photo (`spans` makes those of four sides), those are kept whose sides an
edge really covers.
Source: convex groups by their gap fraction, Jacobs, Robust and efficient detection of salient convex
groups, PAMI 1996; here the support is read off whole lines, so a side may be interrupted by ornament.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import ArrayLike, FloatArray, IndexArray
from ...geometry.polygons import polygon_areas, polygon_moments
from .lines import STEP, LineSet
from .spans import (
    CANDIDATE,
    SHORTEST_SIDE,
    TURN,
    Strips,
    find_quadrangles,
    find_strips,
    off_centre,
    side_support,
)

_SECTORS = 12  # directions around the click from which lines are taken evenly
_TRIANGLE_LINES = 60  # lines around a click of which two are sides of a triangle
_THIRD_LINES = 200  # lines of which one is its third side
_CONSIDERED = 4000  # frames with the best covered sides whose places are compared
_SPARSE = 4  # samples along a line of which one is enough to tell how wide the line looks
_ALIKE = 0.02  # of a frame's size: corners nearer than this are alike


@dataclass(frozen=True, eq=False)
class Frames:
    """Corners (N,4,2) in pixels, of which a triangle repeats its first, and how far its sides are covered.

    `support` (N,4) is 0..1, and 1 for the side that a triangle lacks. `strips` are those that they come from.
    """

    corners: FloatArray
    support: FloatArray
    strips: Strips


@dataclass(frozen=True, eq=False)
class _SeenLines:
    """Lines (n,) seen from a point: the `angle` they cover, how far `apart` they are, in which `sector`."""

    angle: FloatArray
    apart: FloatArray
    sector: IndexArray

    def widest(self, limit: int) -> IndexArray:
        """At most `limit` lines, evenly from all sides.

        Mostly those that look wide from the point; some that are long, however far: the ends of a frieze.
        """
        chosen = np.zeros(len(self.angle), dtype=np.bool_)
        for rank, share in ((self.angle, 0.75), (self.angle * self.apart, 0.25)):
            free = rank * ~chosen
            order = np.argsort(-free, kind="stable")
            order = order[free[order] > 0]
            for number in range(_SECTORS):
                chosen[order[self.sector[order] == number][: int(share * limit / _SECTORS)]] = True
        return np.flatnonzero(chosen)


def find_frames(
    lines: LineSet, click: ArrayLike, least_support: float, line_limit: int, keep: int = 200
) -> Frames:
    """Frames around a click (u, v), at most `keep`: well covered, and the click well inside."""
    point = np.asarray(click, dtype=np.float64) - lines.centre
    seen = _seen_from(lines, point)
    strips = find_strips(lines, seen.widest(line_limit), point)
    corners, support = find_quadrangles(lines, strips, least_support)
    triangles, sides = _triangles(lines, seen, point, least_support)
    corners, support = np.concatenate([corners, triangles]), np.concatenate([support, sides])
    covered = np.log(support).mean(axis=1) + support.min(axis=1)
    best = np.argsort(-covered, kind="stable")[:_CONSIDERED]
    corners, support, covered = corners[best], support[best], covered[best]
    best = _unlike(corners, covered + CANDIDATE * centrality(*polygon_moments(corners), point))[:keep]
    return Frames(corners[best] + lines.centre, support[best], strips)


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


def _seen_from(lines: LineSet, point: FloatArray) -> _SeenLines:
    distance = lines.normal @ point - lines.offset
    covered = lines.covered[:, ::_SPARSE]
    apart = np.abs(distance)
    foot = lines.reach + lines.direction @ point
    along = np.arange(covered.shape[1], dtype=np.float32) * np.float32(STEP * _SPARSE)
    along = along - foot[:, None].astype(np.float32)
    near = apart[:, None].astype(np.float32)
    angle = np.sum(covered * (near / (near**2 + along**2 + np.float32(1e-9))), axis=1).astype(np.float64)
    angle[apart < 3] = 0  # a line through the click bounds nothing
    inward = lines.normal * np.sign(distance)[:, None]
    turn = np.arctan2(inward[:, 1], inward[:, 0]) / (2 * np.pi) + 1
    return _SeenLines(angle, apart, np.floor(turn * _SECTORS).astype(np.int64) % _SECTORS)


def _intersections(normal: FloatArray, offset: FloatArray) -> FloatArray:
    """Corner (n,n,2) where line i meets line j; NaN where the way around does not turn enough from i to j."""
    cross = normal[:, None, 0] * normal[None, :, 1] - normal[:, None, 1] * normal[None, :, 0]
    safe = np.where(cross > TURN, cross, np.nan)
    u = (offset[:, None] * normal[None, :, 1] - normal[:, None, 1] * offset[None, :]) / safe
    v = (normal[:, None, 0] * offset[None, :] - offset[:, None] * normal[None, :, 0]) / safe
    return np.stack([u, v], axis=-1)


def _triangles(
    lines: LineSet, seen: _SeenLines, point: FloatArray, least: float
) -> tuple[FloatArray, FloatArray]:
    """Triangles around a point of two lines near it and a third: corners (N,4,2), support (N,4)."""
    chosen = seen.widest(_THIRD_LINES)
    near = np.isin(chosen, seen.widest(_TRIANGLE_LINES))
    side = np.where(lines.normal[chosen] @ point > lines.offset[chosen], 1.0, -1.0)
    corner = _intersections(lines.normal[chosen] * side[:, None], lines.offset[chosen] * side)
    inside = np.all(np.abs(corner) <= lines.centre + 3, axis=-1)
    i, j = np.nonzero(inside & near[:, None] & near)
    pair, k = np.nonzero(inside[j] & inside[:, i].T)
    i, j = i[pair], j[pair]
    corners = np.stack([corner[i, j], corner[j, k], corner[k, i], corner[i, j]], axis=1)
    long = np.linalg.norm(np.diff(corners, axis=1), axis=2).min(axis=1) > SHORTEST_SIDE
    corners, i, j, k = corners[long], i[long], j[long], k[long]
    sides = [
        side_support(lines, chosen[on], corners[:, n], corners[:, n + 1]) for n, on in enumerate((j, k, i))
    ]
    support = np.stack([*sides, np.ones(len(i))], axis=1)
    good = support.min(axis=1) >= least
    return corners[good], support[good]


def centrality(middle: FloatArray, spread: FloatArray, click: FloatArray) -> FloatArray:
    """Log prior (N,) that a user clicks so far off the middle: centroids (N,2), covariances (N,2,2)."""
    off = click - middle
    uu, vv, uv = spread[:, 0, 0], spread[:, 1, 1], spread[:, 0, 1]
    determinant = np.maximum(uu * vv - uv * uv, 1e-9)
    distance2 = (vv * off[:, 0] ** 2 - 2 * uv * off[:, 0] * off[:, 1] + uu * off[:, 1] ** 2) / determinant
    return off_centre(np.sqrt(np.maximum(distance2, 0)))
