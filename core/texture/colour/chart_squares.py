"""Squares in a photo and the grids they form, seen at any angle: the first step to a chart of patches."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from ...arrays import AnyArray, BoolArray, ByteArray, FloatArray, IndexArray

_SMALLEST = 60.0
"""Area (pixels) of the smallest square."""
_SHORTEST = 24
"""Pixels along the outline of such a square."""
_LARGEST = 1 / 60
"""Largest share of the photo that one square takes."""
_LONGEST = 3.5
"""Ratio of the sides of a square seen at an angle."""
_GAP = (1.0, 1.6)
"""Distance between the centres of neighbours in sides of a square."""
_SEEDS = 400
_FEWEST = 8
"""Squares that a grid must have."""


@dataclass(frozen=True, eq=False)
class Squares:
    """n squares: `centre` (n,2) pixels; `side` (n,2,2) the vectors along two sides, the second clockwise."""

    centre: FloatArray
    side: FloatArray


@dataclass(frozen=True, eq=False)
class Grid:
    """Squares in a grid: `homography` (3,3) from column and row to pixels; `low`, `high` (2,) indices met."""

    homography: FloatArray
    low: IndexArray
    high: IndexArray


def find_squares(photo: ByteArray) -> Squares:
    """Find convex four-sided patches in any channel of a photo (H,W,3) that stand out from what is around."""
    corners: list[FloatArray] = []
    largest = photo.shape[0] * photo.shape[1] * _LARGEST
    smooth = cv2.medianBlur(photo, 3)
    for size in (16, 40, 100):
        window = max(7, max(photo.shape[:2]) // size) | 1
        for channel in cv2.split(smooth):
            for kind in (cv2.THRESH_BINARY, cv2.THRESH_BINARY_INV):
                mask = cv2.adaptiveThreshold(channel, 255, cv2.ADAPTIVE_THRESH_MEAN_C, kind, window, -3)
                mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
                outlines = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]
                corners += [q for q in (_square(o, largest) for o in outlines) if q is not None]
    if not corners:
        return Squares(np.zeros((0, 2)), np.zeros((0, 2, 2)))
    quads = np.stack(corners)
    centre = quads.mean(axis=1)
    side = np.stack(
        [
            0.5 * (quads[:, 1] - quads[:, 0] + quads[:, 2] - quads[:, 3]),
            0.5 * (quads[:, 3] - quads[:, 0] + quads[:, 2] - quads[:, 1]),
        ],
        axis=1,
    )
    return _distinct(Squares(centre, side))


def _square(outline: AnyArray, largest: float) -> FloatArray | None:
    """Corners (4,2) of an outline, clockwise from the upper left, if it is a square seen at an angle."""
    if len(outline) < _SHORTEST:  # most are specks: a length is known without measuring
        return None
    area = cv2.contourArea(outline)
    if not _SMALLEST <= area <= largest:
        return None
    polygon = cv2.approxPolyDP(outline, 0.08 * cv2.arcLength(outline, True), True)
    if len(polygon) != 4 or not cv2.isContourConvex(polygon):
        return None
    corners = polygon[:, 0].astype(np.float64)
    edge = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    if edge.max() > _LONGEST * edge.min() or area < 0.75 * cv2.contourArea(polygon):
        return None
    around = corners - corners.mean(axis=0)
    return corners[np.argsort(np.arctan2(around[:, 1], around[:, 0]), kind="stable")]


def _distinct(squares: Squares) -> Squares:
    """One square per place: the middle of those found there in several channels."""
    size = np.linalg.norm(squares.side, axis=2).mean(axis=1)
    order = np.argsort(-size, kind="stable")
    tree = cKDTree(squares.centre)
    taken = np.zeros(len(size), dtype=np.bool_)
    centre, side = [], []
    for number in order:
        if taken[number]:
            continue
        near = np.array(tree.query_ball_point(squares.centre[number], 0.25 * size[number]))
        alike = near[(size[near] > 0.7 * size[number]) & ~taken[near]]
        taken[near] = True
        centre.append(np.median(squares.centre[alike], axis=0))
        side.append(np.median(squares.side[alike], axis=0))
    return Squares(np.array(centre), np.array(side))


def find_grids(centre: FloatArray, side: FloatArray, shape: tuple[int, int]) -> list[Grid]:
    """Grids of at least eight squares that a chart of `shape` (columns, rows), either way up, may explain.

    Squares (n,2), (n,2,2) as in `Squares`. The largest grids come first.
    """
    if len(centre) < _FEWEST:
        return []
    tree = cKDTree(centre)
    done = np.zeros(len(centre), dtype=np.bool_)
    found: list[tuple[int, Grid]] = []
    for seed in range(min(len(centre), _SEEDS)):
        if done[seed]:
            continue
        member, index = _grown(seed, centre, side, tree)
        if len(member) < _FEWEST:
            continue
        done[member] = True
        grid = _fitted(centre[member], index)
        if grid is not None and sorted(grid.high - grid.low + 1)[1] <= max(shape):
            found.append((len(member), grid))
    found.sort(key=lambda pair: -pair[0])
    return [grid for _, grid in found]


def _grown(seed: int, centre: FloatArray, side: FloatArray, tree: cKDTree) -> tuple[IndexArray, IndexArray]:
    """Squares reached from `seed` in steps of one square, and their column and row: (m,), (m,2)."""
    place = {seed: (0, 0)}
    taken = {(0, 0)}
    queue = [seed]
    size = np.linalg.norm(side, axis=2).mean(axis=1)
    while queue:
        number = queue.pop(0)
        for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
            column, row = place[number]
            target = (column + sign, row) if axis == 0 else (column, row + sign)
            if target in taken:
                continue
            other = _neighbour(number, sign * side[number, axis], centre, size, tree)
            if other is None or other in place:
                continue
            place[other] = target
            taken.add(target)
            queue.append(other)
    member = np.array(list(place), dtype=np.int64)
    return member, np.array([place[int(number)] for number in member], dtype=np.int64)


def _neighbour(
    number: int, step: FloatArray, centre: FloatArray, size: FloatArray, tree: cKDTree
) -> int | None:
    """The square of alike size next to one in the direction of `step` (2,), a side long."""
    length = float(np.linalg.norm(step))
    best, nearest = None, 0.25
    for other in tree.query_ball_point(centre[number] + 1.25 * step, 0.6 * length):
        offset = (centre[other] - centre[number]) / length
        along = float(offset @ step) / length
        across = abs(float(offset[0] * step[1] - offset[1] * step[0])) / length
        alike = 0.6 < size[other] / size[number] < 1.7
        if other != number and alike and _GAP[0] <= along <= _GAP[1] and across < nearest:
            best, nearest = int(other), across
    return best


def _fitted(centre: FloatArray, index: IndexArray) -> Grid | None:
    """Homography through the squares of a grid, stray ones left out; None without two rows and columns."""
    if (np.ptp(index, axis=0) < 1).any():
        return None
    pitch = float(np.median(np.linalg.norm(np.diff(centre[np.lexsort(index.T)], axis=0), axis=1)))
    found = fit_homography(index.astype(np.float64), centre, max(0.12 * pitch, 1.0))
    if found is None or np.count_nonzero(found[1]) < _FEWEST:
        return None
    kept = index[found[1]]
    return Grid(found[0], kept.min(axis=0), kept.max(axis=0))


def fit_homography(
    source: FloatArray, target: FloatArray, tolerance: float
) -> tuple[FloatArray, BoolArray] | None:
    """Homography (3,3) between points (n,2), and which are within `tolerance` pixels; None if none fits."""
    found: tuple[AnyArray | None, AnyArray] = cv2.findHomography(source, target, cv2.RANSAC, tolerance)
    homography, inside = found
    if homography is None:
        return None
    return homography.astype(np.float64), inside.ravel() > 0
