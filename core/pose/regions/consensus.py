"""Search around a moment solution for the pose at which most of the boundary lies exactly on the outline.

Moments average over all drawing errors; where these are gross (bites and bumps), part of the outline is
still right. Each boundary sample keeps the offsets of the outline pieces it may belong to, as a linear
function of the pose, so that hundreds of poses are scored with a few array operations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray, IndexArray
from ...cameras.base import Camera
from .contour import ContourPair, outward

NEIGHBOURS = 32  # outline points looked at per boundary sample: about 10 px on a plain outline
BESIDE = 0.71  # px along the outline within which a point is opposite to the sample
CHOICES = 4  # offsets kept per sample
SAMPLES = 120  # boundary samples per region
DRAWS = 600  # poses tried
CLIMBS = 24  # of these, the best ones climb
STRETCH = (1.5, 3.0)  # the draws spread wider than the moments' covariance says, in turn
SHARP = 0.4  # share of `near` by which right pieces of outline scatter
NEAR = 0.7  # px: as close as outline and boundary come where both are right
CLIMB_SCALES = (2.0, 1.5, 1.5, 1.2, 1.0, 0.8, 0.7, 0.6, 0.5, 0.5)
WINDOWS = 8  # sides of each region that are left out in turn, overlapping
WINDOW = 0.4  # share of a region's boundary that is left out
FAR = 3.0  # sigmas of the moments: as far as leaving out a side may move the pose
WINDOW_SCALES = (6.0, 4.0, 3.0, 2.0, 1.5, 1.2, 1.0, 0.8, 0.7, 0.6, 0.5, 0.5)


@dataclass(frozen=True, eq=False)
class Offsets:
    """Signed distances (N,C) px from outline pieces to N boundary samples, inf for none; slopes (N,6).

    `region` (N,) numbers the pairs that samples belong to, in order along their boundaries.
    """

    values: FloatArray
    jacobian: FloatArray
    region: IndexArray


@dataclass(frozen=True, eq=False)
class Consensus:
    """Local optima, best first: steps (K,6) from the pose searched around, none of them alike.

    `shares` (K,) of the samples come near the outline; `scores` (K,) count those right on it most.
    """

    steps: FloatArray
    shares: FloatArray
    scores: FloatArray


def outline_offsets(
    camera: Camera, pairs: Sequence[ContourPair], rotation: FloatArray, translation: FloatArray
) -> Offsets:
    """Collect, for every boundary sample, its offsets from outline pieces that run alike opposite to it."""
    values, slopes = [], []
    for pair in pairs:
        stride = max(1, len(pair.surface.points) // SAMPLES)
        turned = pair.surface.points[::stride] @ rotation.T
        pixels, jacobian = camera.project_with_jacobian(turned + translation)
        normals = outward(jacobian, pair.surface.tangents[::stride] @ rotation.T)
        seen = np.all(np.isfinite(pixels), axis=1) & np.all(np.isfinite(normals), axis=1)
        pixels, normals, jacobian, turned = pixels[seen], normals[seen], jacobian[seen], turned[seen]
        values.append(_offsets(pair, pixels, normals))
        across = np.einsum("ni,nij->nj", normals, jacobian)
        slopes.append(np.concatenate([np.cross(turned, across), across], axis=1))
    region = np.repeat(np.arange(len(values)), [len(part) for part in values])
    return Offsets(np.concatenate(values), np.concatenate(slopes), region)


def _offsets(pair: ContourPair, pixels: FloatArray, normals: FloatArray) -> FloatArray:
    """Offsets (n, CHOICES) of the nearest outline pieces opposite to each pixel, inf for fewer."""
    count = min(NEIGHBOURS, len(pair.image.points))
    near = np.asarray(pair.image.tree.query(pixels, k=count)[1]).reshape(len(pixels), count)
    there = pair.image.normals[near]
    away = pixels[:, None] - pair.image.points[near]
    alike = np.einsum("nkj,nj->nk", there, normals) > pair.alike
    beside = np.abs(there[..., 0] * away[..., 1] - there[..., 1] * away[..., 0]) < BESIDE
    offset = there[..., 0] * away[..., 0] + there[..., 1] * away[..., 1]
    offset = np.where(alike & beside & (pair.image.weights[near] > 0), offset, np.inf)
    nearest = np.argsort(np.abs(offset), axis=1)[:, :CHOICES]
    return np.take_along_axis(offset, nearest, axis=1)


def search_consensus(
    offsets: Offsets, covariance: FloatArray, generator: np.random.Generator, near: float = NEAR
) -> Consensus:
    """Draw poses from `covariance` (6,6), let the best climb by reweighted least squares, rank."""
    spread = _square_root(covariance)
    slope = offsets.jacobian @ spread
    choices = [np.ascontiguousarray(column) for column in offsets.values.T]
    draws = np.resize(STRETCH, DRAWS)[:, None] * generator.standard_normal((DRAWS, 6))
    draws[0] = 0.0
    distance = _nearest(choices, draws @ slope.T)
    score = (1.0 / (1.0 + (distance / (2.0 * near)) ** 2)).sum(axis=1)
    climbers = draws[np.argsort(-score)[:CLIMBS]]
    climbers[-1] = 0.0
    for scale in CLIMB_SCALES:
        climbers = climbers - _ascent(choices, slope, climbers, scale * near / NEAR)
    return _ranked(choices, slope, spread, climbers, near)


def search_without_sides(
    offsets: Offsets, covariance: FloatArray, near: float
) -> tuple[Consensus, FloatArray]:
    """Climb from a pose with one side of one region left out, each side in turn; rank with all counted.

    A side that was drawn beside the true one can pull the search to a pose at which it coincides; without it
    the others lead back. Also returned is how far apart the climbers end, as a covariance (6,6) of the pose;
    none counts for more than `FAR` sigmas of `covariance`.
    Source: delete-d jackknife, Shao and Wu 1989, with a redescending loss.
    """
    spread = _square_root(covariance)
    slope = offsets.jacobian @ spread
    choices = [np.ascontiguousarray(column) for column in offsets.values.T]
    kept = _without_windows(offsets.region)
    climbers = np.zeros((len(kept), 6))
    for scale in WINDOW_SCALES:
        climbers = climbers - _ascent(choices, slope, climbers, scale * near / NEAR, kept)
    length = np.linalg.norm(climbers, axis=1, keepdims=True)
    jumps = climbers * np.minimum(FAR / np.maximum(length, FAR), 1.0) @ spread.T
    left_out = 1.0 - float(kept.mean())
    scatter = (1.0 - left_out) / left_out * (jumps.T @ jumps) / len(jumps)
    return _ranked(choices, slope, spread, climbers, near), scatter


def _without_windows(region: IndexArray) -> FloatArray:
    """Weights (K,N), 0 on one window of one region and 1 elsewhere."""
    rows = []
    for number in np.unique(region):
        own = np.flatnonzero(region == number)
        width = int(WINDOW * len(own))
        for first in np.linspace(0, len(own), WINDOWS, endpoint=False).astype(np.int64):
            row = np.ones(len(region))
            row[own[(first + np.arange(width)) % len(own)]] = 0.0
            rows.append(row)
    return np.stack(rows)


def _ranked(
    choices: Sequence[FloatArray], slope: FloatArray, spread: FloatArray, climbers: FloatArray, near: float
) -> Consensus:
    """Local optima that climbers (K,6) have reached, in units of `spread`, best first."""
    distance = _nearest(choices, climbers @ slope.T)
    scores = np.mean(np.exp(-0.5 * (distance / (SHARP * near)) ** 2), axis=1)
    order = _unlike(climbers @ slope.T, np.argsort(-scores), 1.5 * near)
    shares = np.mean(np.abs(distance[order]) < near, axis=1)
    return Consensus(climbers[order] @ spread.T, shares, scores[order])


def _unlike(shifts: FloatArray, order: IndexArray, least: float) -> IndexArray:
    """Of poses in `order`, those whose boundary shifts (K,N) differ from earlier ones by `least` px rms."""
    kept: list[int] = []
    for index in order.tolist():
        if all(np.mean((shifts[index] - shifts[other]) ** 2) > least**2 for other in kept):
            kept.append(index)
    return np.array(kept, dtype=np.int64)


def _square_root(covariance: FloatArray) -> FloatArray:
    """Matrix A (6,6) with `A Aᵀ = covariance`, also where rounding made that slightly indefinite."""
    sigma = np.sqrt(np.maximum(np.nan_to_num(np.diag(covariance)), 0.0))
    correlation = covariance / np.maximum(np.outer(sigma, sigma), 1e-300)
    values, vectors = np.linalg.eigh(np.nan_to_num(correlation, posinf=0.0, neginf=0.0))
    root: FloatArray = sigma[:, None] * vectors * np.sqrt(np.maximum(values, 1e-12))
    return root


def _nearest(choices: Sequence[FloatArray], shift: FloatArray) -> FloatArray:
    """Smallest signed distance per pose and sample: choices C x (N,), shift (K,N) -> (K,N)."""
    best = choices[0] + shift
    for column in choices[1:]:
        other = column + shift
        np.copyto(best, other, where=np.abs(other) < np.abs(best))
    return best


def _ascent(
    choices: Sequence[FloatArray],
    slope: FloatArray,
    climbers: FloatArray,
    scale: float,
    kept: FloatArray | float = 1.0,
) -> FloatArray:
    """Reweighted least-squares step (K,6) at a scale (px), held by a weak pull to where it is."""
    distance = _nearest(choices, climbers @ slope.T)
    weight = kept / (1.0 + (distance / scale) ** 2) ** 2
    weighted = np.where(np.isfinite(distance), distance, 0.0) * weight
    normal = (slope.T * weight[:, None]) @ slope
    pull = 1e-6 + 1e-12 * np.einsum("kii->k", normal)
    normal += pull[:, None, None] * np.eye(6)
    step: FloatArray = np.linalg.solve(normal, (weighted @ slope)[..., None])[..., 0]
    return step
