"""Which photos see the same surface, and which of their features are the same point of it."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
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
    first = np.flatnonzero(np.isfinite(predicted[: settings.first_features, 0]))
    second = np.arange(min(len(b), settings.first_features))
    if len(first) < 8 or len(second) < 8:
        return np.zeros((0, 2), dtype=np.int64)
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    forth = matcher.knnMatch(
        a.descriptors[first].astype(np.float32), b.descriptors[second].astype(np.float32), 2
    )
    found = [
        (m[0].queryIdx, m[0].trainIdx) for m in forth if len(m) == 2 and m[0].distance < 0.8 * m[1].distance
    ]
    pairs = np.array(found, dtype=np.int64).reshape(-1, 2)
    pairs = np.stack([first[pairs[:, 0]], second[pairs[:, 1]]], axis=1)
    near = np.linalg.norm(predicted[pairs[:, 0]] - b.pixels[pairs[:, 1]], axis=1) < radius
    return _agreeing(_one_to_one(pairs[near]), b, hits_a, settings)


def _one_to_one(pairs: IndexArray) -> IndexArray:
    """Leave out features of the second photo that were matched twice."""
    _, inverse, counts = np.unique(pairs[:, 1], return_inverse=True, return_counts=True)
    single: IndexArray = pairs[counts[inverse] == 1]
    return single


def _agreeing(pairs: IndexArray, b: Features, hits_a: Hits, settings: JointSettings) -> IndexArray:
    """Matches that agree on one pose of photo b, given the scan points that photo a sees."""
    if len(pairs) < 8:
        return np.zeros((0, 2), dtype=np.int64)
    points = hits_a.points[pairs[:, 0]]
    scene = Sightings(b.rays[pairs[:, 1]], b.to_pixels[pairs[:, 1]], points - points.mean(axis=0))
    # wide: the scan points carry the error of photo a's pose
    search = PointSettings(threshold=12.0, max_samples=2000, seed=settings.seed)
    poses = search_poses(scene, search, keep=1)
    if not poses:
        return np.zeros((0, 2), dtype=np.int64)
    good = np.linalg.norm(scene.residuals(*poses[0]), axis=1) < search.threshold
    # a pose always fits a few; more than that is evidence
    return pairs[good] if good.sum() >= max(8, 0.25 * len(pairs)) else np.zeros((0, 2), dtype=np.int64)


def match_closely(a: Features, b: Features, predicted: FloatArray, radius: float) -> IndexArray:
    """Matches (M,2) among the features of b within `radius` pixels of where a's should lie (N,2).

    The best of at most 16 candidates has to be clearly better than the next, and each other's best.
    """
    usable = np.flatnonzero(np.isfinite(predicted[:, 0]))
    if len(usable) == 0 or len(b) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    tree = cKDTree(b.pixels)
    found = tree.query(predicted[usable], k=min(16, len(b)), distance_upper_bound=radius)
    valid, candidate = np.isfinite(found[0]), np.asarray(found[1])
    mine = a.descriptors[usable].astype(np.float32)
    theirs = b.descriptors[np.where(valid, candidate, 0)].astype(np.float32)
    apart = np.linalg.norm(theirs - mine[:, None, :], axis=2)
    apart[~valid] = np.inf
    similar_size = np.abs(np.log2(a.size[usable][:, None] / b.size[np.where(valid, candidate, 0)])) < 1.5
    apart[~similar_size] = np.inf
    order = np.argsort(apart, axis=1)
    rows = np.arange(len(usable))
    best, next_best = apart[rows, order[:, 0]], apart[rows, order[:, 1]]
    # lone candidates are held to the distance that good matches have
    clear = np.isfinite(best) & (best < 0.85 * next_best) & (best < 220.0)
    pairs = np.stack([usable[clear], candidate[rows, order[:, 0]][clear]], axis=1)
    return _best_of_each(pairs, best[clear])


def _best_of_each(pairs: IndexArray, apart: FloatArray) -> IndexArray:
    """Of matches to the same feature of the second photo, the one with the most similar descriptor."""
    order = np.lexsort((apart, pairs[:, 1]))
    first = np.r_[True, pairs[order][1:, 1] != pairs[order][:-1, 1]] if len(order) else np.zeros(0, bool)
    best: IndexArray = pairs[order[first]].astype(np.int64)
    return best
