"""Refining the alignment of two scans by their surfaces: iterated closest points, point to plane."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import ArrayLike, FloatArray, IndexArray
from ..errors import ScanError
from ..geometry.rigid import exp_so3
from ..jobs import Job, Progress, drain
from ..settings import AlignSettings
from .align import Alignment

_NEIGHBOURS = 12
"""Points that a normal is estimated from."""

_HELD = 2e-3
"""Smallest eigenvalue of the normalised equations at which surfaces hold each other in every direction."""


def align_by_surface(
    source: ArrayLike,
    target: ArrayLike,
    initial: Alignment | None = None,
    settings: AlignSettings | None = None,
) -> Alignment:
    """Run `align_by_surface_job` to its end."""
    return drain(align_by_surface_job(source, target, initial, settings))


def align_by_surface_job(
    source: ArrayLike,
    target: ArrayLike,
    initial: Alignment | None = None,
    settings: AlignSettings | None = None,
) -> Job[Alignment]:
    """Rigid motion that brings the points of one scan (N,3) onto the surface of another (M,3).

    Starts at `initial` (none: the scans are about aligned already). Pairs within a distance that shrinks from
    `settings.reach` count, with weights that fade for outliers; the target's normals come from its points.
    Raises ScanError when the scans do not meet or can slide along each other.
    Source: method.md 3; Chen and Medioni (1992); weights by Tukey with the median's deviation as scale.
    """
    settings = settings or AlignSettings()
    yield Progress(0.0, "Sampling the scans")
    rng = np.random.default_rng(0)
    fixed = _sample(np.asarray(target, dtype=np.float64), settings.target_points, rng)
    moving = _sample(np.asarray(source, dtype=np.float64), settings.source_points, rng)
    origin = fixed.mean(axis=0)
    fixed = fixed - origin
    rotation = np.eye(3) if initial is None else initial.rotation
    shift = rotation @ origin - origin if initial is None else initial.apply(origin[None])[0] - origin
    moving = moving - origin
    tree = cKDTree(fixed)
    yield Progress(0.1, "Finding surface normals")
    normals = surface_normals(fixed, tree)
    least = max(settings.least_reach, 3 * _spacing(fixed, tree))
    reach = max(settings.reach, least)
    for step in range(settings.iterations):
        yield Progress(
            0.2 + 0.8 * step / settings.iterations, f"Aligning, pairs within {1000 * reach:.0f} mm"
        )
        moved = moving @ rotation.T + shift
        near, pairs = _pairs(moved, tree, reach)
        distances = np.sum((moved[near] - fixed[pairs]) * normals[pairs], axis=1)
        turn, move, centre, scale = _motion(moved[near], normals[pairs], distances)
        rotation = exp_so3(turn) @ rotation
        shift = exp_so3(turn) @ (shift - centre) + centre + move
        settled = (
            float(np.linalg.norm(move)) + float(np.linalg.norm(turn)) * _radius(moved[near]) < 1e-3 * scale
        )
        narrowest = max(4 * scale, least)
        if settled and reach <= narrowest:
            break
        reach = max(0.6 * reach, narrowest)
    translation = shift + origin - rotation @ origin
    return Alignment(rotation, translation, np.abs(distances), len(near) / len(moving))


def surface_normals(points: FloatArray, tree: cKDTree) -> FloatArray:
    """Unit normals (N,3) of points, up to their sign: the direction of least spread of their neighbours."""
    normals = np.empty_like(points)
    for start in range(0, len(points), 1 << 16):
        block = slice(start, start + (1 << 16))
        _, index = tree.query(points[block], k=min(_NEIGHBOURS, len(points)))
        around = points[index] - points[index].mean(axis=1, keepdims=True)
        _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
        normals[block] = vectors[:, :, 0]
    return normals


def _spacing(points: FloatArray, tree: cKDTree) -> float:
    """Median distance of points from their nearest neighbour: pairs on the surface are hardly closer."""
    few = points[:: max(1, len(points) // 10_000)]
    distance, _ = tree.query(few, k=2)
    return float(np.median(np.asarray(distance)[:, 1]))


def _sample(points: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 100:
        raise ScanError(f"{len(points)} points are too few to align surfaces; align by point pairs")
    return points if len(points) <= count else points[rng.choice(len(points), count, replace=False)]


def _pairs(moved: FloatArray, tree: cKDTree, reach: float) -> tuple[IndexArray, IndexArray]:
    """Moving points that have a fixed one within reach, and that one."""
    distance, index = (np.asarray(part) for part in tree.query(moved, distance_upper_bound=reach))
    near: IndexArray = np.flatnonzero(np.isfinite(distance))
    if len(near) < max(50, 0.01 * len(moved)):
        raise ScanError(
            f"the scans do not meet within {1000 * reach:.0f} mm; align them by picked points first or raise "
            "the reach"
        )
    return near, index[near].astype(np.int64)


def _motion(
    points: FloatArray, normals: FloatArray, distances: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Small turn (rad, about the points' centre) and move (m) that close the distances along the normals.

    Returns also that centre and the scale of the distances (m).
    """
    centre = points.mean(axis=0)
    radius = _radius(points)
    scale = max(1.4826 * float(np.median(np.abs(distances - np.median(distances)))), 1e-6)
    weight = (
        np.clip(1 - (distances / (4.685 * max(scale, float(np.median(np.abs(distances)))))) ** 2, 0, None)
        ** 2
    )
    # Turns are counted in radii, so that all six unknowns are metres.
    rows = np.concatenate([np.cross(points - centre, normals) / radius, normals], axis=1)
    matrix = (rows * weight[:, None]).T @ rows / max(float(weight.sum()), 1e-12)
    if np.linalg.eigvalsh(matrix)[0] < _HELD:
        raise ScanError(
            "the surfaces that the scans share can slide or turn along each other (a plain wall or floor); "
            "align by picked points, or take scans that share walls of several directions"
        )
    solution = np.linalg.solve(
        matrix, -(rows * (weight * distances)[:, None]).sum(axis=0) / float(weight.sum())
    )
    return solution[:3] / radius, solution[3:], centre, scale


def _radius(points: FloatArray) -> float:
    return max(float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1)))), 1e-9)
