"""The outline stage for one candidate: search, refine, and tell whether outlines really coincide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray
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

LOCK = 5.0
"""Lock ratio from which outlines count as coinciding; wrong fits stay near 1 to 3."""

LEAST_SHARE = 0.1
"""Share of the boundary that must lie on the outline for a lock."""

SURE_SHARE = 0.6
"""Share of the boundary on the outline at which there is no need to search for more."""

SCALES = (1.0, 0.7, 0.5, 0.5, 0.5)
"""Pixels at which a distance loses its weight, step by step."""


@dataclass(frozen=True, eq=False)
class OutlineFit:
    """A candidate after the outline stage: pose from the problem's origin and its covariance (6,6).

    `share` is the share of the boundary within 0.7 px of the outline; `locked` whether that is no accident;
    `front` whether all surface regions are seen from the side their faces are wound for.
    """

    rotation: FloatArray
    translation: FloatArray
    covariance: FloatArray
    share: float
    locked: bool
    front: bool


def image_contours(problem: Problem) -> list[ImageContour]:
    """Smooth outlines of every pair of the problem."""
    return [image_contour(pair.outlines, pair.hidden) for pair in problem.outlines]


def fit_outlines(
    problem: Problem,
    images: Sequence[ImageContour],
    rotation: FloatArray,
    translation: FloatArray,
    covariance: FloatArray,
) -> OutlineFit:
    """Search near a moment solution with its covariance (6,6), refine, and judge."""
    camera = problem.camera
    surfaces = [surface_contour(camera, pair.boundaries, rotation, translation) for pair in problem.outlines]
    pairs = [ContourPair(image, surface) for image, surface in zip(images, surfaces, strict=True)]
    turned, moved = _nearest_consensus(problem, pairs, rotation, translation, covariance)
    turned, moved = refine_by_contours(camera, pairs, turned, moved, SCALES)
    matches = [match(camera, pair, turned, moved) for pair in pairs]
    distances = np.concatenate([found.distances for found in matches])
    share = float(np.mean(np.abs(distances) < 0.7))
    locked = lock_ratio(distances) > LOCK and share > LEAST_SHARE
    front = all(surface.front for surface in surfaces)
    if not locked:
        return OutlineFit(rotation, translation, covariance, share, False, front)
    return OutlineFit(turned, moved, outline_covariance(pairs, matches), share, True, front)


def _nearest_consensus(
    problem: Problem,
    pairs: Sequence[ContourPair],
    rotation: FloatArray,
    translation: FloatArray,
    covariance: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Pose with most of the boundary on the outline; a second search starts from the first one's result."""
    generator = np.random.default_rng(20)  # the same input gives the same pose
    for spread in (1.0, 0.25):
        offsets = outline_offsets(problem.camera, pairs, rotation, translation)
        found = search_consensus(offsets, spread * covariance, generator)
        rotation = exp_so3(found.steps[0, :3]) @ rotation
        translation = translation + found.steps[0, 3:]
        if found.shares[0] > SURE_SHARE:
            break
    return rotation, translation
