"""Search for the pose that most points agree on: RANSAC with three-point solutions."""

from __future__ import annotations

from itertools import combinations
from math import comb

import numpy as np

from ...arrays import FloatArray, IndexArray
from ...settings import PointSettings
from .minimal import solve_p3p
from .sightings import Sightings

BATCH = 256


def search_poses(
    sightings: Sightings, settings: PointSettings, keep: int = 8
) -> list[tuple[FloatArray, FloatArray]]:
    """Best poses (rotation, centre) by truncated squared error, best first, at most `keep`.

    Few points: every triple is tried. Source: Fischler and Bolles 1981; Torr and Zisserman 2000 (MSAC).
    """
    rng = np.random.default_rng(settings.seed)
    best: list[tuple[float, FloatArray, FloatArray]] = []
    needed, drawn = float(settings.max_samples), 0
    for triples in _triples(len(sightings), settings.max_samples, rng):
        rotations, centres = solve_p3p(sightings.rays[triples], sightings.points[triples])
        drawn += len(triples)
        if len(rotations):
            costs = _truncated_costs(sightings, rotations, centres, settings.threshold)
            order = np.argsort(costs)[:keep]
            best += [(float(costs[i]), rotations[i], centres[i]) for i in order]
            best = sorted(best, key=lambda entry: entry[0])[:keep]
            # the cost bounds the outlier share from above, so this never stops too early
            inlier_share = max(1.0 - best[0][0] / len(sightings), 1e-3)
            needed = np.log(1 - settings.confidence) / np.log1p(-min(inlier_share**3, 1 - 1e-9))
        if drawn >= needed:
            break
    return [(rotation, centre) for _, rotation, centre in best]


def _triples(count: int, limit: int, rng: np.random.Generator) -> list[IndexArray]:
    """All triples when few, else batches of random ones: list of (B,3)."""
    if comb(count, 3) <= 4 * BATCH:
        return [np.array(list(combinations(range(count), 3)), dtype=np.int64)]
    batches = []
    for _ in range(-(-limit // BATCH)):
        triples = rng.integers(0, count, (BATCH, 3))
        distinct = (triples != np.roll(triples, 1, axis=1)).all(axis=1)
        batches.append(triples[distinct])
    return batches


def _truncated_costs(
    sightings: Sightings, rotations: FloatArray, centres: FloatArray, threshold: float
) -> FloatArray:
    """Sum of min(1, (error / threshold)^2) over the points for each pose: (S,)."""
    in_camera = np.einsum("sij,nj->sni", rotations, sightings.points)
    in_camera -= np.einsum("sij,sj->si", rotations, centres)[:, None, :]
    direction = in_camera / np.linalg.norm(in_camera, axis=2, keepdims=True)
    error = np.einsum("nij,snj->sni", sightings.to_pixels, direction - sightings.rays)
    # the tangent plane cannot tell a point from its opposite: those behind the ray count as misses
    squared = np.einsum("sni,sni->sn", error, error) / threshold**2
    squared[np.einsum("snj,nj->sn", direction, sightings.rays) <= 0] = 1.0
    costs: FloatArray = np.minimum(squared, 1.0).sum(axis=1)
    return costs
