"""The outline stage for one candidate: search, refine, and tell whether outlines really coincide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import FloatArray
from ...cameras.base import Camera
from ...geometry.rigid import exp_so3
from .consensus import outline_offsets, search_consensus
from .contour import (
    ContourPair,
    ImageContour,
    image_contour,
    lock_ratio,
    match,
    refine_by_contours,
    surface_contour,
)
from .covariance import outline_covariance
from .problem import Problem


@dataclass(frozen=True)
class Level:
    """How precisely outlines are expected to coincide.

    `near` (px): as close as they come where both are right; `half_width`: samples on either side of a local
    fit; `alike`: least cosine of normals that match; `block`: pixels of boundary whose errors hang together;
    `ratio` and `share`: lock ratio and share of the boundary near the outline that wrong fits do not reach;
    `bias`: what a stretch may be off as a whole (px), one standard deviation.
    """

    near: float
    half_width: int
    alike: float
    block: int
    ratio: float
    share: float
    bias: float


LEVELS = (
    Level(0.7, 3, 0.85, 24, 5.0, 0.10, 0.0),
    Level(2.0, 10, 0.75, 200, 7.0, 0.50, 0.5),
    Level(4.0, 20, 0.70, 300, 14.0, 0.75, 1.0),
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

SCALES = (1.5, 1.0, 0.7, 0.7, 0.7)
"""Distances lose their weight at these multiples of `Level.near`, step by step."""


@dataclass(frozen=True, eq=False)
class OutlineFit:
    """A candidate after the outline stage: pose from the problem's origin and its covariance (6,6).

    Within `near` px the outlines coincide over a `share` of the boundary; `near` is infinite where they do
    not and the pose is the moments'. `front`: all regions are seen from the side their faces are wound for.
    """

    rotation: FloatArray
    translation: FloatArray
    covariance: FloatArray
    share: float
    near: float
    front: bool


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
    contours: Contours, rotation: FloatArray, translation: FloatArray, covariance: FloatArray
) -> OutlineFit:
    """Search near a moment solution with its covariance (6,6), level by level until one locks."""
    for level in LEVELS:
        fit = _fit_at(level, contours, rotation, translation, covariance)
        if fit.near < np.inf:
            break
    return fit


def _fit_at(
    level: Level, contours: Contours, rotation: FloatArray, translation: FloatArray, covariance: FloatArray
) -> OutlineFit:
    camera = contours.problem.camera
    pairs = contours.pairs(level, rotation, translation)
    turned, moved = _nearest_consensus(level, camera, pairs, rotation, translation, covariance)
    turned, moved = refine_by_contours(camera, pairs, turned, moved, [s * level.near for s in SCALES])
    matches = [match(camera, pair, turned, moved) for pair in pairs]
    distances = np.concatenate([found.distances for found in matches])
    share = float(np.mean(np.abs(distances) < level.near))
    front = all(pair.surface.front for pair in pairs)
    if lock_ratio(distances, level.near) < level.ratio + ALONE / len(pairs) or share < level.share:
        return OutlineFit(rotation, translation, covariance, share, np.inf, front)
    if level is LEVELS[0] and share > CLEAN_SHARE:
        pairs = contours.pairs(CLEAN, turned, moved)
        turned, moved = refine_by_contours(camera, pairs, turned, moved, SCALES[-3:])
        matches = [match(camera, pair, turned, moved) for pair in pairs]
    spread = outline_covariance(pairs, matches, SCALES[-1] * level.near, level.bias)
    return OutlineFit(turned, moved, spread, share, level.near, front)


def _nearest_consensus(
    level: Level,
    camera: Camera,
    pairs: Sequence[ContourPair],
    rotation: FloatArray,
    translation: FloatArray,
    covariance: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Pose with most of the boundary on the outline; a second search starts from the first one's result."""
    generator = np.random.default_rng(20)  # the same input gives the same pose
    for spread in (1.0, 0.25):
        offsets = outline_offsets(camera, pairs, rotation, translation)
        found = search_consensus(offsets, spread * covariance, generator, level.near)
        rotation = exp_so3(found.steps[0, :3]) @ rotation
        translation = translation + found.steps[0, 3:]
        if found.shares[0] > SURE_SHARE:
            break
    return rotation, translation
