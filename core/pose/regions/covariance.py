"""How sure a pose from regions is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import FloatArray, IndexArray
from ...cameras.base import Camera
from ...geometry.rigid import skew
from .contour import ContourPair, Match, outward, robust_weights, surface_contour
from .moment_pair import MomentPair
from .problem import OutlinePair

LEAST_CURVATURE = 0.2
"""Share of the weights' slope that is always kept, so that poorly matched outlines cannot look unsolvable."""

GRAIN = 0.14
"""Pixels of error that a smoothed pixel outline keeps at every sample, however well it fits."""


JOINED = (1, 2, 4, 8, 16)
"""How many of the shortest stretches of boundary may hang together."""

LEAST_STRETCHES = 3
"""Stretches per unknown below which their scatter says nothing."""

OPEN = 1e-9
"""Least eigenvalue of a normal matrix with unit diagonal up to which a direction is not held at all."""


def moment_covariance(
    pairs: Sequence[MomentPair], rotation: FloatArray, translation: FloatArray
) -> FloatArray:
    """Covariance (6,6) of (turn about the origin, shift) from the moment equations' own residuals."""
    normal, squares, equations = np.zeros((6, 6)), 0.0, 0
    for pair in pairs:
        residual, jacobian = pair.residuals_with_jacobian(rotation[None], translation[None])
        normal += jacobian[0].T @ jacobian[0]
        squares += float(residual[0] @ residual[0])
        equations += residual.shape[1]
    return squares / (equations - 6) * stable_inverse(normal)


def outline_covariance(
    pairs: Sequence[ContourPair], matches: Sequence[Match], scale: float, bias: float
) -> FloatArray:
    """Covariance (P,P) of (turn about the origin, shift, lens) from the distances left between outlines.

    Errors hang together along a stretch of boundary, so that stretches, not samples, count as independent:
    the sandwich `H⁻¹ (Σ g gᵀ) H⁻¹` with one gradient g per stretch, plus the grain of the pixels and a `bias`
    (px) that whole stretches may have. H is the weighted `JᵀJ`, less what Geman-McClure weights lose of their
    slope at the distances met. How long stretches are depends on who drew the outline: slips are short, the
    edge of a polygon by hand is long. Of several lengths the one that leaves the most doubt is taken.
    Source: Huber 1981 (M-estimators); Liang and Zeger 1986 (stretches).
    """
    size = matches[0].jacobian.shape[1]
    normal, grain, weight, curvature = np.zeros((size, size)), np.zeros((size, size)), 0.0, 0.0
    scores = []
    for found in matches:
        weights = robust_weights(found.distances, scale)
        weighted = found.jacobian * weights[:, None]
        normal += weighted.T @ found.jacobian
        grain += GRAIN**2 * weighted.T @ weighted
        squared = (np.nan_to_num(found.distances) / scale) ** 2
        weight += weights.sum()
        curvature += float(np.sum(weights * (1.0 - 3.0 * squared) / (1.0 + squared)))
        scores.append(weighted)
    inverse = stable_inverse(normal * max(curvature / weight, LEAST_CURVATURE))
    spreads = [_spread(pairs, matches, scores, bias, joined) for joined in JOINED]
    enough = [spread for spread, stretches in spreads if stretches >= LEAST_STRETCHES * size]
    candidates = [inverse @ (spread + grain) @ inverse for spread in enough or [spreads[0][0]]]
    doubts = [float(np.trace(np.linalg.solve(candidates[0], candidate))) for candidate in candidates]
    return candidates[int(np.argmax(doubts))]


def _spread(
    pairs: Sequence[ContourPair],
    matches: Sequence[Match],
    scores: Sequence[FloatArray],
    bias: float,
    joined: int,
) -> tuple[FloatArray, int]:
    """Scatter (P,P) of the gradients of stretches, `joined` of the shortest to one, and their number."""
    size = scores[0].shape[1]
    spread, stretches = np.zeros((size, size)), 0
    for pair, found, weighted in zip(pairs, matches, scores, strict=True):
        stretch = pair.surface.block // joined
        gradients = per_stretch(stretch, weighted * np.nan_to_num(found.distances)[:, None])
        lifts = bias * per_stretch(stretch, weighted)
        stretches += np.count_nonzero(np.any(gradients != 0, axis=1))
        spread += gradients.T @ gradients + lifts.T @ lifts
    correction = stretches / max(stretches - size, 1)
    return correction * spread, stretches


def per_stretch(stretch: IndexArray, values: FloatArray) -> FloatArray:
    """Sums (S,P) of values (n,P) over the stretches 0..S-1 they belong to (n,)."""
    sums = np.zeros((int(stretch.max()) + 1, values.shape[1]))
    np.add.at(sums, stretch, values)
    return sums


def turn_per_pixel(
    camera: Camera, pairs: Sequence[OutlinePair], rotation: FloatArray, translation: FloatArray
) -> float:
    """Degrees that the camera can turn, and move along, while outlines move across themselves by a pixel rms.

    Outlines are smoothed over a twentieth of their length, so that the corners of a polygon that stands for
    a curve do not count. A few degrees are usual; a circle or an ellipse has no bound.
    """
    slopes = []
    for pair in pairs:
        half_width = max(3, sum(map(len, pair.outlines)) // 40)
        surface = surface_contour(camera, pair.boundaries, rotation, translation, half_width, 1)
        turned = surface.points @ rotation.T
        _, jacobian = camera.project_with_jacobian(turned + translation)
        normals = outward(jacobian, surface.tangents @ rotation.T)
        across = np.einsum("ni,nij->nj", normals, jacobian)
        slopes.append(np.concatenate([np.cross(turned, across), across], axis=1))
    slope = np.concatenate(slopes)
    slope = slope[np.isfinite(slope).all(axis=1)]
    spread = stable_inverse(slope.T @ slope / len(slope))
    return float(np.degrees(np.sqrt(np.trace(spread[:3, :3]))))


def stable_inverse(normal: FloatArray) -> FloatArray:
    """Inverse of a positive normal matrix whose parameters have different units."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal * np.outer(scale, scale)
    inverse: FloatArray = np.linalg.inv(scaled + 1e-12 * np.eye(len(normal))) * np.outer(scale, scale)
    return inverse


def determined(normal: FloatArray) -> bool:
    """Whether a normal matrix, its parameters in any units, holds every one of them."""
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(size, size)
    return bool(np.all(np.isfinite(scaled)) and np.linalg.eigvalsh(scaled)[0] > OPEN)


def world_covariance(covariance: FloatArray, rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """From (turn about the origin, shift) to (turn, camera centre in the world): (6,6) -> (6,6).

    With `c = -Rᵀ t`: `dc = -Rᵀ dt - Rᵀ [t]× w`.
    """
    change = np.zeros((6, 6))
    change[:3, :3] = np.eye(3)
    change[3:, :3] = -rotation.T @ skew(translation)
    change[3:, 3:] = -rotation.T
    moved: FloatArray = change @ covariance @ change.T
    return moved
