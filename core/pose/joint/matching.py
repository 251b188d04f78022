"""Which photos see the same surface, and which of their features are the same point of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import FloatArray, IndexArray
from ...cameras.base import Camera
from ...jobs import Job, Progress
from ...settings import JointSettings, PointSettings
from ..points.consensus import search_poses
from ..points.perturbation import camera_points
from ..points.sightings import Sightings
from .features import Features, Hits, Surface

SAMPLE = 300
"""Features of a photo that stand for the surface it sees."""

MOST_ROUGHLY, MOST_CLOSELY = 48, 16
"""Candidates that a feature is compared with at most, while poses are rough and when they are not."""

ALIKE = 220.0
"""Largest distance of descriptors (of length 512) of a match."""

BLOCK = 1 << 16
"""Pairs of descriptors compared at once."""

JUDGES = 200
"""Matches that judge whether a pose is the one that all agree on, while many are tried."""


def choose_pairs_job(
    cameras: Sequence[Camera],
    poses: Sequence[tuple[FloatArray, FloatArray]],
    hits: Sequence[Hits],
    surface: Surface,
    settings: JointSettings,
) -> Job[list[tuple[int, int]]]:
    """Pairs (i, j), i < j, of photos that see enough of the same surface from similar directions."""
    count = len(cameras)
    overlap = np.zeros((count, count))
    limit = np.cos(np.radians(settings.max_parallax))
    for i in range(count):
        yield Progress(i / count, "Choosing photos to match")
        points = hits[i].points[np.isfinite(hits[i].points[:, 0])][:SAMPLE]
        if len(points) < settings.min_ties:
            continue
        from_i = _directions(points, poses[i][1])
        for j in range(count):
            if i == j:
                continue
            pixels = cameras[j].project(camera_points(*poses[j], points))
            seen = np.isfinite(pixels).all(axis=1) & cameras[j].in_frame(pixels)
            seen &= np.einsum("nk,nk->n", from_i, _directions(points, poses[j][1])) > limit
            if seen.sum() >= settings.min_ties:
                # a surface hidden by less than a twentieth of the distance may be due to the rough pose
                reach = float(np.median(np.linalg.norm(points - poses[j][1], axis=1)))
                seen[seen] = ~surface.caster.occluded(poses[j][1], points[seen], 0.05 * reach)
            overlap[i, j] = seen.sum() / len(points)
    return _best_partners(np.minimum(overlap, overlap.T), settings.partners)


def _directions(points: FloatArray, centre: FloatArray) -> FloatArray:
    away = points - centre
    out: FloatArray = away / np.linalg.norm(away, axis=1, keepdims=True)
    return out


def _best_partners(overlap: FloatArray, partners: int) -> list[tuple[int, int]]:
    pairs = set()
    for i, row in enumerate(overlap):
        for j in np.argsort(-row)[:partners]:
            if row[j] > 0.1:
                pairs.add((min(i, int(j)), max(i, int(j))))
    return sorted(pairs)


def match_roughly(
    a: Features, b: Features, hits_a: Hits, predicted: FloatArray, radius: float, settings: JointSettings
) -> IndexArray:
    """Matches (M,2) between the strongest features of two photos whose poses are only roughly known.

    `predicted` (N,2): where the scan points of a's features should lie in b, off by up to `radius` pixels.
    The descriptors decide, then the matches have to agree on a pose of b relative to the scan.
    """
    count = settings.first_features
    candidates = _candidates(a, b, predicted[:count], radius, min(len(b), count), MOST_ROUGHLY)
    return _agreeing(_clear_matches(*candidates, 0.8), b, hits_a, settings)


def _agreeing(pairs: IndexArray, b: Features, hits_a: Hits, settings: JointSettings) -> IndexArray:
    """Matches that agree on one pose of photo b, given the scan points that photo a sees."""
    if len(pairs) < 8:
        return np.zeros((0, 2), dtype=np.int64)
    points = hits_a.points[pairs[:, 0]]
    scene = Sightings(b.rays[pairs[:, 1]], b.to_pixels[pairs[:, 1]], points - points.mean(axis=0))
    judges = np.arange(len(pairs)) % -(-len(pairs) // JUDGES) == 0
    # wide: the scan points carry the error of photo a's pose
    search = PointSettings(threshold=12.0, max_samples=2000, seed=settings.seed)
    poses = search_poses(scene.select(judges), search, keep=1)
    if not poses:
        return np.zeros((0, 2), dtype=np.int64)
    good = np.linalg.norm(scene.residuals(*poses[0]), axis=1) < search.threshold
    # a pose always fits a few; more than that is evidence
    return pairs[good] if good.sum() >= max(8, 0.25 * len(pairs)) else np.zeros((0, 2), dtype=np.int64)


def match_closely(a: Features, b: Features, predicted: FloatArray, radius: float) -> IndexArray:
    """Matches (M,2) among the features of b within `radius` pixels of where a's should lie (N,2)."""
    return _clear_matches(*_candidates(a, b, predicted, radius, len(b), MOST_CLOSELY), 0.85)


def _candidates(
    a: Features, b: Features, predicted: FloatArray, radius: float, count: int, most: int
) -> tuple[IndexArray, FloatArray]:
    """Pairs (P,2) of a's features and at most `most` of b's first `count` near them, and how unlike (P,).

    Only what lies near and has about the same size is compared: that is what keeps hundreds of photos
    quick, and what tells apart windows that look alike.
    """
    usable = np.flatnonzero(np.isfinite(predicted[:, 0]))
    if len(usable) == 0 or count == 0:
        return np.zeros((0, 2), dtype=np.int64), np.zeros(0)
    found = cKDTree(b.pixels[:count]).query(
        predicted[usable], k=np.arange(1, min(most, count) + 1), distance_upper_bound=radius
    )
    row, place = np.nonzero(np.isfinite(found[0]))
    pairs = np.stack([usable[row], np.asarray(found[1])[row, place]], axis=1).astype(np.int64)
    alike = np.abs(np.log2(a.size[pairs[:, 0]] / b.size[pairs[:, 1]])) < 1.5
    pairs = pairs[alike]
    apart = np.empty(len(pairs))
    for start in range(0, len(pairs), BLOCK):
        mine, theirs = pairs[start : start + BLOCK].T
        off = a.descriptors[mine].astype(np.float32) - b.descriptors[theirs]
        apart[start : start + BLOCK] = np.sqrt(np.einsum("pk,pk->p", off, off))
    return pairs, apart


def _clear_matches(pairs: IndexArray, apart: FloatArray, ratio: float) -> IndexArray:
    """Of candidates (P,2) the matches (M,2) that are clearly better than the next, and each other's best."""
    order = np.lexsort((apart, pairs[:, 0]))
    pairs, apart = pairs[order], apart[order]
    first = np.flatnonzero(np.r_[True, pairs[1:, 0] != pairs[:-1, 0]]) if len(pairs) else order
    following = np.append(first[1:], len(pairs))
    rivals = np.append(apart, np.inf)
    next_best = np.where(following - first > 1, rivals[np.minimum(first + 1, len(pairs))], np.inf)
    best = apart[first]
    # lone candidates are held to the distance that good matches have
    clear = (best < ratio * next_best) & (best < ALIKE)
    return _best_of_each(pairs[first][clear], best[clear])


def _best_of_each(pairs: IndexArray, apart: FloatArray) -> IndexArray:
    """Of matches to the same feature of the second photo, the one with the most similar descriptor."""
    order = np.lexsort((apart, pairs[:, 1]))
    first = np.r_[True, pairs[order][1:, 1] != pairs[order][:-1, 1]] if len(order) else np.zeros(0, bool)
    best: IndexArray = pairs[order[first]].astype(np.int64)
    return best
