"""The outline stage: search around candidates, refine, and tell whether outlines really coincide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ...arrays import BoolArray, FloatArray
from ...cameras.base import Camera
from ...geometry.rigid import exp_so3
from .consensus import SHARP, outline_offsets, search_consensus, search_without_sides
from .contour import (
    ContourPair,
    ImageContour,
    image_contour,
    lock_ratio,
    match,
    refine_by_contours,
    surface_contour,
)
from .covariance import moment_covariance, outline_covariance
from .pixels import fit_between_pixels
from .problem import Problem


@dataclass(frozen=True)
class Level:
    """How precisely outlines are expected to coincide.

    `near` (px): as close as they come where both are right; `half_width`: samples on either side of a local
    fit; `alike`: least cosine of normals that match; `block`: pixels of boundary whose errors hang together;
    `ratio` and `share`: lock ratio and share of the boundary near the outline that wrong fits do not reach;
    `steep`: what the ratio must grow by with the share: where outlines are right apart from slips, little
    lies just beside.
    """

    near: float
    half_width: int
    alike: float
    block: int
    ratio: float
    share: float
    steep: float


LEVELS = (
    Level(0.7, 3, 0.85, 24, 5.0, 0.10, 40.0),
    Level(2.0, 10, 0.75, 200, 7.0, 0.50, 0.0),
    Level(4.0, 20, 0.70, 300, 14.0, 0.75, 0.0),
)
"""From outlines right to the pixel apart from slips to outlines drawn by hand round a jagged scan."""

CLEAN = replace(LEVELS[0], half_width=7)
"""Where there are no slips, wider local fits average the pixels' grain better."""

CLEAN_SHARE = 0.85
"""Share of the boundary on the outline from which there are no slips."""

ALONE = 5.0
"""What one region alone must have more of the lock ratio; n regions the n-th part of it."""

SURE_SHARE = 0.6
"""Share of the boundary on the outline at which there is no need to search for more."""

FALSE_LOCKS = 0.3
"""Of locks of one region in parts, not exact to the pixel, the share that may be wrong: then moments hold."""

PLAIN_SHARE = 0.3
"""The same where nothing else comes near."""

MOST_OPTIMA = 3
"""Local optima followed per search."""

WORTHY = 0.6
"""Score, as a share of the best's, from which a local optimum is followed."""

AGREED = 0.8
"""The same where a side was left out."""

BEYOND = 8.5
"""Multiples of `Level.near` over which distances of boundary that is not on the outline scatter."""

SHARES = np.array([0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 0.95])
"""Shares of the boundary on the outline that are tried to find the likeliest."""

BLOCKS = 3.0
"""Independent pieces of evidence per stretch of boundary whose errors hang together."""

FEW = 5
"""Sides of an only region up to which one of them drawn beside the true edge does not show."""

STRAIGHT = 0.02
"""Share of a smoothed boundary's length by which a side may depart from a straight line."""

SIDE = 0.08
"""Share of a region's boundary from which a straight piece of outline beside it is no slip."""

SIDE_SAMPLES = 100
"""Samples of a boundary below which such a piece is too short to tell."""

SAME = 0.7
"""Multiples of `Level.near` by which the boundaries of different fits differ, root mean square."""

SCALES = (1.5, 1.0, 0.7, 0.7, 0.7)
"""Distances lose their weight at these multiples of `Level.near`, step by step."""


@dataclass(frozen=True, eq=False)
class OutlineFit:
    """A candidate after the outline stage: pose from the problem's origin and its covariance (6,6).

    Within `near` px the outlines coincide over a `share` of the boundary; `near` is infinite where they do
    not and the pose is the moments'. `evidence` is the logarithm of how much likelier the distances are than
    if no part of the boundary lay on the outline. `front`: all regions are seen from the side their faces
    are wound for; `exact`: even the pixels agree.
    """

    rotation: FloatArray
    translation: FloatArray
    covariance: FloatArray
    share: float
    near: float
    evidence: float
    front: bool
    exact: bool = False


Rigid = tuple[FloatArray, FloatArray]
"""Rotation (3,3) and translation (3,) of a pose."""


class Contours:
    """Smooth outlines of every pair of a problem, made once per level."""

    def __init__(self, problem: Problem):
        self.problem = problem
        self._images: dict[int, list[ImageContour]] = {}

    def pairs(self, level: Level, rotation: FloatArray, translation: FloatArray) -> list[ContourPair]:
        """Outlines with the boundaries as they are sampled at a pose."""
        if level.half_width not in self._images:
            self._images[level.half_width] = [
                image_contour(pair.outlines, pair.hidden, level.half_width) for pair in self.problem.outlines
            ]
        surfaces = [
            surface_contour(
                self.problem.camera, pair.boundaries, rotation, translation, level.half_width, level.block
            )
            for pair in self.problem.outlines
        ]
        images = self._images[level.half_width]
        return [ContourPair(i, s, level.alike) for i, s in zip(images, surfaces, strict=True)]


def fit_outlines(
    level: Level, contours: Contours, rotation: FloatArray, translation: FloatArray, covariance: FloatArray
) -> list[OutlineFit]:
    """Fits near a moment solution with its covariance (6,6) where outlines coincide, best first; maybe none.

    Each local optimum of the search is refined by itself: which of them is right shows only then.
    """
    pairs = contours.pairs(level, rotation, translation)
    found = _optima(level, contours.problem.camera, pairs, rotation, translation, covariance)
    fits = [_refined(level, contours, pairs, *pose) for pose in found]
    locked = [fit for fit in fits if fit is not None]
    return _apart(contours.problem.camera, pairs, sorted(locked, key=lambda fit: -fit.evidence), level)


def fit_like(
    level: Level, contours: Contours, fit: OutlineFit, start: Rigid, other: Rigid
) -> list[OutlineFit]:
    """Fit at the pose that is to `fit` as the moment solution `other` is to `start`, if outlines lock there.

    Solutions of a symmetric region differ by a movement of the region onto itself: where one locks, all do,
    whatever a search misses.
    """
    turn = start[0].T @ other[0]
    rotation = fit.rotation @ turn
    translation = fit.translation + fit.rotation @ start[0].T @ (other[1] - start[1])
    pairs = contours.pairs(level, rotation, translation)
    found = _refined(level, contours, pairs, rotation, translation)
    return [] if found is None else [found]


def fits_without_sides(contours: Contours, fit: OutlineFit) -> tuple[OutlineFit, list[OutlineFit]]:
    """Fit no surer than its sides agree unless it is exact, and the fits that leaving out a side leads to.

    These are at the fit's own level or a finer one, and no surer than it where they are not exact either.
    """
    camera = contours.problem.camera
    reached = next(k for k, level in enumerate(LEVELS) if level.near == fit.near)
    pairs = contours.pairs(LEVELS[reached], fit.rotation, fit.translation)
    offsets = outline_offsets(camera, pairs, fit.rotation, fit.translation)
    doubt = moment_covariance(contours.problem.moments, fit.rotation, fit.translation)
    found, scatter = search_without_sides(offsets, doubt + fit.covariance, fit.near)
    fits = []
    elsewhere = np.mean((found.steps @ offsets.jacobian.T) ** 2, axis=1) > (1.5 * fit.near) ** 2
    worthy = found.scores >= AGREED * found.scores[0]
    for step in found.steps[elsewhere & worthy][:MOST_OPTIMA]:
        rotation, translation = exp_so3(step[:3]) @ fit.rotation, fit.translation + step[3:]
        for level in LEVELS[: reached + 1]:
            here = contours.pairs(level, rotation, translation)
            other = _refined(level, contours, here, rotation, translation)
            if other is not None:
                fits.append(finished(contours, other))
                break
    return _scattered(fit, scatter), [_scattered(other, scatter) for other in fits]


def _scattered(fit: OutlineFit, scatter: FloatArray) -> OutlineFit:
    """Fit with a covariance that is wider by `scatter` unless even its pixels agree."""
    return fit if fit.exact else replace(fit, covariance=fit.covariance + scatter)


def unlocked(
    contours: Contours, rotation: FloatArray, translation: FloatArray, covariance: FloatArray
) -> OutlineFit:
    """Moment solution as it is, where outlines coincide nowhere."""
    pairs = contours.pairs(LEVELS[0], rotation, translation)
    front = all(pair.surface.front for pair in pairs)
    return OutlineFit(rotation, translation, covariance, 0.0, np.inf, 0.0, front)


def finished(contours: Contours, fit: OutlineFit) -> OutlineFit:
    """Give a fit to a fraction of a pixel its last accuracy: between the pixels, or averaged further."""
    if fit.near != LEVELS[0].near:
        return fit
    camera = contours.problem.camera
    exact = fit_between_pixels(camera, contours.problem.outlines, fit.rotation, fit.translation)
    if exact is not None and not _side_beside(contours, fit):
        rotation, translation, covariance = exact
        proven = not few_sides(contours, rotation, translation)
        return replace(fit, rotation=rotation, translation=translation, covariance=covariance, exact=proven)
    if fit.share < SURE_SHARE:  # wrong fits lock rarely, and never on the pixel
        doubt = moment_covariance(contours.problem.moments, fit.rotation, fit.translation)
        share = FALSE_LOCKS / len(contours.problem.outlines) ** 2
        return replace(fit, covariance=fit.covariance + share * doubt)
    if fit.share < CLEAN_SHARE:
        return fit
    pairs = contours.pairs(CLEAN, fit.rotation, fit.translation)
    turned, moved = refine_by_contours(camera, pairs, fit.rotation, fit.translation, SCALES[-3:])
    matches = [match(camera, pair, turned, moved) for pair in pairs]
    spread = outline_covariance(pairs, matches, SCALES[-1] * fit.near)
    return replace(fit, rotation=turned, translation=moved, covariance=spread)


def few_sides(contours: Contours, rotation: FloatArray, translation: FloatArray) -> bool:
    """Whether there is but one boundary and it has at most `FEW` straight sides, as a pose shows it."""
    problem = contours.problem
    if sum(len(loops) for pair in problem.outlines for loops in pair.boundaries) > 1:
        return False
    (pair,) = contours.pairs(LEVELS[-1], rotation, translation)  # smooth: a scan's border is jagged
    drawn = problem.camera.project(pair.surface.points @ rotation.T + translation)
    outline = drawn[np.isfinite(drawn).all(axis=1)].astype(np.float32)
    corners = cv2.approxPolyDP(outline, STRAIGHT * cv2.arcLength(outline, True), True)
    return len(corners) <= FEW


def _side_beside(contours: Contours, fit: OutlineFit) -> bool:
    """Whether a side was drawn along something beside the true edge: then others may have been, unseen.

    Slips are ragged; such a side keeps its distance from the boundary, or departs from it in a straight line.
    """
    camera = contours.problem.camera
    for pair in contours.pairs(LEVELS[0], fit.rotation, fit.translation):
        found = match(camera, pair, fit.rotation, fit.translation)
        distances = found.distances[pair.image.weights[found.nearest] > 0]
        if len(distances) >= SIDE_SAMPLES and np.any(_straight_beside(distances, fit.near)):
            return True
    return False


def _straight_beside(distances: FloatArray, near: float) -> BoolArray:
    """Per stretch of `SIDE` of the boundary, whether distances (n,) px are off but on a straight line."""
    width = int(SIDE * len(distances))
    stretches = sliding_window_view(np.concatenate([distances, distances[: width - 1]]), width)
    along = np.linspace(-1.0, 1.0, width)
    mean = stretches.mean(axis=1, keepdims=True)
    slope = stretches @ along[:, None] / (along @ along)
    scatter = np.sqrt(np.mean((stretches - mean - slope * along) ** 2, axis=1))
    off = np.abs(stretches).min(axis=1) >= near
    straight: BoolArray = off & (scatter < SHARP * near)  # NaN, where no outline belongs, is not
    return straight


def _refined(
    level: Level,
    contours: Contours,
    pairs: Sequence[ContourPair],
    rotation: FloatArray,
    translation: FloatArray,
) -> OutlineFit | None:
    """Robust Gauss-Newton from a pose; None if the outlines do not lock there."""
    camera = contours.problem.camera
    turned, moved = refine_by_contours(camera, pairs, rotation, translation, [s * level.near for s in SCALES])
    matches = [match(camera, pair, turned, moved) for pair in pairs]
    distances = np.concatenate([found.distances for found in matches])
    share = float(np.mean(np.abs(distances) < level.near))
    least = level.ratio + ALONE / len(pairs) + level.steep * max(share - PLAIN_SHARE, 0.0)
    if lock_ratio(distances, level.near) < least or share < level.share:
        return None
    spread = outline_covariance(pairs, matches, SCALES[-1] * level.near)
    evidence = sum(
        _log_evidence(found.distances, level.near) * pair.surface.spacing * BLOCKS / level.block
        for pair, found in zip(pairs, matches, strict=True)
    )
    front = all(pair.surface.front for pair in pairs)
    return OutlineFit(turned, moved, spread, share, level.near, evidence, front)


def _log_evidence(distances: FloatArray, near: float) -> float:
    """Log-likelihood of distances (px) being partly on the outline, against all being anywhere beside it."""
    width = SHARP * near
    size = np.where(np.isfinite(distances), distances, np.inf)
    density = np.exp(-0.5 * (size / width) ** 2) * 2.0 * BEYOND * near / (width * np.sqrt(2.0 * np.pi))
    return float(np.max(np.log1p(SHARES[:, None] * (density - 1.0)).sum(axis=1)))


def _optima(
    level: Level,
    camera: Camera,
    pairs: Sequence[ContourPair],
    rotation: FloatArray,
    translation: FloatArray,
    covariance: FloatArray,
) -> list[tuple[FloatArray, FloatArray]]:
    """Poses with most of the boundary on the outline; a second search starts from the first one's best."""
    generator = np.random.default_rng(20)  # the same input gives the same pose
    poses: list[tuple[FloatArray, FloatArray]] = []
    for spread in (1.0, 0.25):
        offsets = outline_offsets(camera, pairs, rotation, translation)
        if len(offsets.values) == 0:
            break  # nothing of the boundary is in view
        found = search_consensus(offsets, spread * covariance, generator, level.near)
        followed = found.steps[found.scores >= WORTHY * found.scores[0]][:MOST_OPTIMA]
        here = [(exp_so3(step[:3]) @ rotation, translation + step[3:]) for step in followed]
        poses = here + poses[1:]  # the best of before has been searched around
        rotation, translation = here[0]
        if found.shares[0] > SURE_SHARE or (len(poses) == 1 and found.shares[0] > PLAIN_SHARE):
            break
    return poses


def _apart(
    camera: Camera, pairs: Sequence[ContourPair], fits: Sequence[OutlineFit], level: Level
) -> list[OutlineFit]:
    """Fits without those whose boundary lies where that of an earlier one does."""
    points = np.concatenate([pair.surface.points[::8] for pair in pairs])
    kept: list[tuple[OutlineFit, FloatArray]] = []
    for fit in fits:
        drawn = camera.project(points @ fit.rotation.T + fit.translation)
        off = [np.nanmean(np.sum((drawn - other) ** 2, axis=1)) for _, other in kept]
        if all(np.sqrt(size) > SAME * level.near for size in off):
            kept.append((fit, drawn))
    return [fit for fit, _ in kept]
