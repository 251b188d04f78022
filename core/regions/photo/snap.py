"""Moving outlines onto the edges of a photo, to a fraction of a pixel.

Pixels are those of the photo at full resolution; the centre of the top-left pixel is (0, 0).
"""

from __future__ import annotations

import cv2
import numpy as np

from ...arrays import ArrayLike, ByteArray, FloatArray, IndexArray
from ...errors import RegionError
from ...geometry.contours import resampled, smoothed
from ...jobs import Job, drain, part
from .band import across_band_job
from .best_path import best_path
from .edges import as_photo

_OFFSET_STEP = 0.5  # pixels between the places tried across an outline
_FAINTEST = 0.004  # mean gradient along a side below which there is no edge
_STIFFNESS = 0.15  # cost of one offset step between neighbours, in units of a typical edge


def snap_outline_job(image: ArrayLike, loop: ArrayLike, reach: float, step: float = 2.0) -> Job[FloatArray]:
    """Closed outline (n,2) moved onto the strongest connected edge within `reach` pixels: -> (m,2).

    Dynamic programming along the outline over offsets on its normals; then a parabola through the edge's
    strength gives the fraction of a pixel. Where there is no edge the outline stays.
    Source: Amini, Weymouth and Jain, Using dynamic programming for solving variational problems in vision,
    PAMI 1990.
    """
    photo, points = as_photo(image), _checked(loop)
    even = resampled(points, step)
    curve = smoothed(even, 3)
    normal = np.stack([-curve.tangents[:, 1], curve.tangents[:, 0]], axis=1)
    offset = np.arange(-reach, reach + 1e-9, _OFFSET_STEP)
    places = even[:, None] + offset[:, None] * normal[:, None]
    across = np.abs((yield from across_band_job(photo, places, normal)))
    strength = across / max(float(np.percentile(across.max(axis=1), 75)), 0.02)
    strength -= 0.1 * np.abs(offset) / max(reach, 1.0)  # between equals the nearer one
    path = best_path(strength, _STIFFNESS)
    moved = offset[path] + _OFFSET_STEP * _parabola(strength, path)
    snapped: FloatArray = even + moved[:, None] * normal
    return snapped


def snap_outline(image: ArrayLike, loop: ArrayLike, reach: float, step: float = 2.0) -> FloatArray:
    """Drain `snap_outline_job`."""
    return drain(snap_outline_job(image, loop, reach, step))


def snap_polygon_job(image: ArrayLike, corners: ArrayLike, reach: float) -> Job[FloatArray]:
    """Polygon (n,2) whose sides are moved, as straight lines, onto the edges within `reach` pixels.

    -> (n,2).
    """
    photo, polygon = as_photo(image), _checked(corners)
    count = len(polygon)
    lines = []
    for k in range(count):
        side = _snapped_side_job(photo, polygon[k], polygon[(k + 1) % count], reach)
        lines.append((yield from part(side, k / count, (k + 1) / count)))
    out = polygon.copy()
    for k in range(count):
        met = _meeting(lines[k - 1], lines[k])
        if met is not None and np.linalg.norm(met - polygon[k]) < 4 * reach:
            out[k] = met
    return out


def snap_polygon(image: ArrayLike, corners: ArrayLike, reach: float) -> FloatArray:
    """Drain `snap_polygon_job`."""
    return drain(snap_polygon_job(image, corners, reach))


def _checked(loop: ArrayLike) -> FloatArray:
    points = np.asarray(loop, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3 or not np.all(np.isfinite(points)):
        raise RegionError("An outline to snap needs at least three (u, v) corners.")
    return points


def _parabola(strength: FloatArray, path: IndexArray) -> FloatArray:
    """Fraction of a step (-0.5..0.5) from the path to the top of a parabola through three strengths."""
    rows = np.arange(len(path))
    inner = np.clip(path, 1, strength.shape[1] - 2)
    low, mid, high = (strength[rows, inner + k] for k in (-1, 0, 1))
    bend = low - 2 * mid + high
    top = np.where(bend < -1e-9, 0.5 * (low - high) / np.where(bend < -1e-9, bend, -1.0), 0.0)
    fraction: FloatArray = np.where(path == inner, np.clip(top, -0.5, 0.5), 0.0)
    return fraction


def _snapped_side_job(
    photo: ByteArray, start: FloatArray, end: FloatArray, reach: float
) -> Job[tuple[FloatArray, float]]:
    """Line (unit normal, offset) through the edge near one side.

    Pieces vote, outvoted ones lose their weight.
    """
    vector = end - start
    length = max(float(np.linalg.norm(vector)), 1e-9)
    along = vector / length
    normal = np.array([-along[1], along[0]])
    pieces = int(np.clip(length / 12, 2, 40))
    share = (np.arange(pieces * 8) + 0.5) / (pieces * 8) * 0.94 + 0.03
    offset = np.arange(-reach, reach + 1e-9, _OFFSET_STEP)
    places = start + share[:, None, None] * vector + offset[:, None] * normal
    across = yield from across_band_job(photo, places, np.broadcast_to(normal, (len(places), 2)))
    whole = np.abs(np.mean(np.clip(across, -0.3, 0.3), axis=0)) * (
        1 - 0.15 * np.abs(offset) / max(reach, 1.0)
    )
    peak = int(np.argmax(whole)) if whole.max() > _FAINTEST else len(offset) // 2
    near = np.abs(offset - offset[peak]) <= max(1.5, 0.4 * reach)
    sign = np.sign(np.mean(across[:, peak]))
    votes = sign * across.reshape(pieces, 8, len(offset)).mean(axis=1)[:, near]
    best = np.argmax(votes, axis=1)
    found = offset[near][best] + _OFFSET_STEP * _parabola(votes, best)
    position = share.reshape(pieces, 8).mean(axis=1) - 0.5
    slope, middle = _robust_line(position, found, np.maximum(votes.max(axis=1), 1e-6))
    if whole[peak] <= _FAINTEST:
        slope, middle = 0.0, 0.0
    a, b = start + (middle - 0.5 * slope) * normal, end + (middle + 0.5 * slope) * normal
    direction = (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
    turned = np.array([-direction[1], direction[0]])
    return turned, float(turned @ (a + b) / 2)


def _robust_line(x: FloatArray, y: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """Slope and value at zero of a line through (x, y), reweighted against outliers (Geman-McClure)."""
    design = np.stack([x, np.ones_like(x)], axis=1)
    current = weight.copy()
    line = np.array([0.0, float(np.median(y))])
    for _ in range(10):
        misfit = y - design @ line
        scale = max(1.48 * float(np.median(np.abs(misfit))), 0.3)
        current = weight / (1 + (misfit / scale) ** 2) ** 2
        normal = design.T * current @ design + 1e-9 * np.eye(2)
        line = np.linalg.solve(normal, design.T @ (current * y))
    return float(line[0]), float(line[1])


def _meeting(first: tuple[FloatArray, float], second: tuple[FloatArray, float]) -> FloatArray | None:
    normals = np.stack([first[0], second[0]])
    if abs(np.linalg.det(normals)) < 0.05:
        return None
    point: FloatArray = np.linalg.solve(normals, np.array([first[1], second[1]]))
    return point


def snapped_mask_loops(image: ArrayLike, loops: list[FloatArray], reach: float) -> list[FloatArray]:
    """Snap every loop of a region that is long enough to have an edge; short ones stay."""
    out = []
    for loop in loops:
        perimeter = cv2.arcLength(loop.astype(np.float32)[:, None], True)
        out.append(snap_outline(image, loop, reach) if perimeter > 40 else loop)
    return out
