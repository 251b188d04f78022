"""The last stage for masks: the boundary must pass between the pixels inside and those outside.

An outline of a mask is off by up to half a pixel everywhere, and smoothing leaves a third of that. But every
pixel beside it says more: its centre lies inside the region, or outside. Along a straight edge these
statements pin the boundary down far closer than any average of the outline's steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import expit

from ...arrays import BoolArray, FloatArray, IndexArray
from ...cameras.base import Camera
from ...geometry.rigid import exp_so3
from ...geometry.runs import runs
from .contour import area_turn, metres_per_pixel, outward, shown
from .covariance import determined, per_stretch, stable_inverse
from .problem import OutlinePair

NEAR = 1.3
"""Pixels from the boundary within which an edge between two pixels is taken for the region's outline."""

CORNER = np.cos(np.radians(15.0))
"""Where a boundary turns by more within two samples, distances are not those from one edge: left out."""

SLIPS = 0.02
"""Share of pixels near the boundary that may lie on the wrong side whatever the pose."""

SHARPNESS = (0.15, 0.08, 0.04, 0.02, 0.01)
"""Widths (px) over which a pixel's side becomes certain, step by step to exact."""

BLUNT = 0.08
"""Width from which on the mask was not drawn exactly and this stage has nothing to add."""

STEPS = 4
"""Newton steps per width."""

STRETCH = 12.0
"""Pixels of boundary whose errors hang together, at least."""

JOINED = (1, 2, 4, 8)
"""How many of the shortest stretches may hang together; the number that leaves the most doubt is taken."""

CERTAIN = 0.6
"""Least scatter in units of scoring's variance where the mask is exact: its pixels tell more than that."""

CLEAN = 0.985
"""Share of pixels on their side of the boundary from which a mask is exact all along."""

LEAST_STRETCHES = 18
"""Stretches below which their scatter says nothing."""

SMOOTH = np.cos(np.radians(20.0))
"""Where a boundary turns by less from edge to edge, its vertices may be points of a smooth curve."""


@dataclass(frozen=True, eq=False)
class Sides:
    """Pixels beside the outline: signed distance (n,) px outwards from the boundary, its derivative (n,6).

    `outside` (n,) is 1 for pixels outside the region and -1 for those inside; `block` (n,) numbers stretches
    of the boundary; `sag` (n,) is how far (px) its edges would be off if they were chords of a curve.
    """

    distances: FloatArray
    jacobian: FloatArray
    outside: FloatArray
    block: IndexArray
    sag: FloatArray


def fit_between_pixels(
    camera: Camera, pairs: Sequence[OutlinePair], rotation: FloatArray, translation: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Pose near one that is right to a pixel, at which pixels are most likely on their sides, and covariance.

    None where the outlines are not those of masks, where the masks are not exact to a small part of a pixel,
    or where their pixels leave the pose open. A pixel at distance d lies outside with probability
    `expit(d / width)`, a few lie anywhere; Fisher scoring, with the width getting smaller as long as the
    pixels grow more likely. The covariance is that of scoring or, where it tells of more doubt, of the
    stretches' scatter; whether the boundary's edges are straight or chords of a curve is not known and adds
    to it.
    """
    parts = [_sides(camera, pair, rotation, translation) for pair in pairs if _is_mask(pair)]
    sides = _joined([part for part in parts if len(part.distances)])
    if len(parts) < len(pairs) or sides is None or len(sides.distances) < 60:
        return None
    step, best = np.zeros(6), (-np.inf, np.zeros(6), SHARPNESS[0])
    for width in SHARPNESS:
        step = _scored(sides, step, width)
        likely = _log_likelihood(sides, step, width)
        if likely > best[0]:
            best = (likely, step, width)
    _, step, width = best
    if width >= BLUNT or not determined(_gradients(sides, step, width)[1]):
        return None
    return exp_so3(step[:3]) @ rotation, translation + step[3:], _covariance(sides, step, width)


def _is_mask(pair: OutlinePair) -> bool:
    """Whether all outlines run along the edges of pixels."""
    return all(
        bool(np.all(np.abs(np.roll(loop, -1, axis=0) - loop).sum(axis=1) == 1.0)) for loop in pair.outlines
    )


def _sides(camera: Camera, pair: OutlinePair, rotation: FloatArray, translation: FloatArray) -> Sides:
    """Pixels on both sides of every edge of the outline that the boundary passes closely."""
    points, tangents, corner, sags = _boundary_samples(camera, pair, rotation, translation)
    turned = points @ rotation.T
    pixels, jacobian = camera.project_with_jacobian(turned + translation)
    normals = outward(jacobian, tangents @ rotation.T)
    usable = np.isfinite(pixels).all(axis=1) & np.isfinite(normals).all(axis=1) & ~corner
    middles, outwards = _pixel_edges(pair)
    tree = cKDTree(np.where(np.isfinite(pixels), pixels, -1e6))
    nearest = np.asarray(tree.query(middles, distance_upper_bound=4.0 * NEAR)[1], dtype=np.int64)
    found = np.flatnonzero(nearest < len(pixels))
    nearest = nearest[found]
    middles, outwards = middles[found], outwards[found]
    off = np.sum(normals[nearest] * (middles - pixels[nearest]), axis=1)
    right = usable[nearest] & (np.abs(off) < NEAR) & (np.sum(normals[nearest] * outwards, axis=1) > -0.2)
    nearest, middles, outwards = nearest[right], middles[right], outwards[right]
    across = np.einsum("ni,nij->nj", normals[nearest], jacobian[nearest])
    slope = -np.concatenate([np.cross(turned[nearest], across), across], axis=1)
    distances = [
        np.sum(normals[nearest] * (middles + side * outwards - pixels[nearest]), axis=1)
        for side in (-0.5, 0.5)
    ]
    block = (nearest // STRETCH).astype(np.int64)
    sag = np.einsum("ni,ni->n", across, sags[nearest] @ rotation.T)
    return Sides(
        np.concatenate(distances),
        np.concatenate([slope, slope]),
        np.repeat([-1.0, 1.0], len(nearest)),
        np.concatenate([block, block]),
        np.concatenate([sag, sag]),
    )


def _pixel_edges(pair: OutlinePair) -> tuple[FloatArray, FloatArray]:
    """Middles (n,2) and outward directions (n,2) of the outlines' pixel edges that are seen."""
    steps = [np.roll(loop, -1, axis=0) - loop for loop in pair.outlines]
    middles = np.concatenate([loop + 0.5 * step for loop, step in zip(pair.outlines, steps, strict=True)])
    along = np.concatenate(steps)
    outwards = np.stack([along[:, 1], -along[:, 0]], axis=1)
    seen = shown(middles, outwards, pair.hidden)
    return middles[seen], outwards[seen]


def _boundary_samples(
    camera: Camera, pair: OutlinePair, rotation: FloatArray, translation: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray]:
    """Points (n,3) about a pixel apart on the boundary, tangents, whether it turns there, sags (n,3)."""
    points, tangents, corner, sags = [], [], [], []
    for loops in pair.boundaries:
        size = metres_per_pixel(camera, loops, rotation, translation)
        turn = area_turn(loops, rotation, translation)
        for loop in loops:
            edge = np.roll(loop, -1, axis=0) - loop
            length = np.linalg.norm(edge, axis=1)
            pieces = np.maximum(np.ceil(length / size), 1).astype(np.int64)
            which, place = runs(pieces)
            within = place + 0.5
            direction = (edge / np.maximum(length, 1e-300)[:, None])[which]
            points.append(loop[which] + (within / pieces[which])[:, None] * edge[which])
            tangents.append(turn * direction)
            alike = [np.sum(np.roll(direction, k, axis=0) * direction, axis=1) for k in (-2, 2)]
            corner.append(np.minimum(*alike) < CORNER)
            sags.append(_sag(edge, length)[which])
    return np.concatenate(points), np.concatenate(tangents), np.concatenate(corner), np.concatenate(sags)


def _sag(edge: FloatArray, length: FloatArray) -> FloatArray:
    """Mean offset (n,3) between edges (n,3) and a smooth curve through their ends: `-L² κ / 12`."""
    unit = edge / np.maximum(length, 1e-300)[:, None]
    bend = np.roll(unit, -1, axis=0) - unit  # at the end of each edge
    bend[np.sum(np.roll(unit, -1, axis=0) * unit, axis=1) < SMOOTH] = 0.0
    curvature = bend / np.maximum(0.5 * (length + np.roll(length, -1)), 1e-300)[:, None]
    mean: FloatArray = -(length**2)[:, None] * (curvature + np.roll(curvature, 1, axis=0)) / 24.0
    return mean


def _joined(parts: Sequence[Sides]) -> Sides | None:
    if not parts:
        return None
    first = np.cumsum([0, *(part.block.max() + 1 for part in parts[:-1])])
    return Sides(
        np.concatenate([part.distances for part in parts]),
        np.concatenate([part.jacobian for part in parts]),
        np.concatenate([part.outside for part in parts]),
        np.concatenate([part.block + shift for part, shift in zip(parts, first, strict=True)]),
        np.concatenate([part.sag for part in parts]),
    )


def _log_likelihood(sides: Sides, step: FloatArray, width: float) -> float:
    certain = expit(sides.outside * (sides.distances + sides.jacobian @ step) / width)
    return float(np.sum(np.log(SLIPS + (1 - 2 * SLIPS) * certain)))


def _gradients(sides: Sides, step: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
    """Derivative (n,6) of every pixel's log-likelihood by the pose, and Fisher's information (6,6)."""
    certain = expit(sides.outside * (sides.distances + sides.jacobian @ step) / width)
    chance = SLIPS + (1 - 2 * SLIPS) * certain
    rate = (1 - 2 * SLIPS) * certain * (1 - certain) / width
    information = (sides.jacobian.T * (rate**2 / (chance * (1 - chance)))) @ sides.jacobian
    return sides.jacobian * (sides.outside * rate / chance)[:, None], information


def _scored(sides: Sides, step: FloatArray, width: float) -> FloatArray:
    """Step (6,) after Fisher scoring at one width; it is halved until the pixels grow more likely."""
    likely = _log_likelihood(sides, step, width)
    for _ in range(STEPS):
        gradients, information = _gradients(sides, step, width)
        change = stable_inverse(information + 1e-6 * np.diag(np.diag(information))) @ gradients.sum(axis=0)
        for _ in range(4):
            tried = _log_likelihood(sides, step + change, width)
            if tried > likely:
                break
            change = 0.5 * change
        else:
            break
        step, likely = step + change, tried
    return step


def _covariance(sides: Sides, step: FloatArray, width: float) -> FloatArray:
    gradients, information = _gradients(sides, step, width)
    inverse = stable_inverse(information)
    root = np.linalg.cholesky(inverse)
    beyond = sides.outside * (sides.distances + sides.jacobian @ step)
    least = CERTAIN if np.mean(beyond > -2.0 * width) > CLEAN else 0.9
    best, most = inverse, 0.0
    for joined in JOINED:
        stretches = per_stretch(sides.block // joined, gradients) @ root
        count = np.count_nonzero(np.any(stretches != 0, axis=1))
        if count < LEAST_STRETCHES:
            break
        values, vectors = np.linalg.eigh(count / (count - 6.0) * stretches.T @ stretches)
        doubts = np.maximum(values, least)  # in units of scoring's own variance, along each direction
        if doubts.sum() > most:
            best, most = (root @ vectors * doubts) @ (root @ vectors).T, float(doubts.sum())
    return best + _bent(sides, step, width, inverse)


def _bent(sides: Sides, step: FloatArray, width: float, inverse: FloatArray) -> FloatArray:
    """Covariance (6,6) from not knowing whether the boundary's edges are chords of a curve."""
    certain = expit((sides.distances + sides.jacobian @ step) / width)
    weight = (certain * (1.0 - certain)) / width**2
    shift = inverse @ (sides.jacobian.T @ (weight * sides.sag))
    return np.outer(shift, shift)
