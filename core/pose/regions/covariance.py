"""How sure a pose from regions is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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

SCATTERING = 3.0
"""Stretches per unknown below which their scatter says nothing."""

ALIKE = 1.5
"""Stretches per unknown below which not even their common variance shows."""

USUAL_OFFSET = 0.3
"""Standard deviation of what a whole stretch is off, before any is measured, in scales of the weights."""

USUAL_WORTH = 6.0
"""Measured stretches that this counts as much as."""

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


def outline_covariance(pairs: Sequence[ContourPair], matches: Sequence[Match], scale: float) -> FloatArray:
    """Covariance (P,P) of (turn about the origin, shift, lens) from the distances left between outlines.

    Errors hang together along a stretch of boundary, so that stretches, not samples, count as independent:
    the sandwich `H⁻¹ S H⁻¹`, plus the grain of the pixels. S is the scatter `Σ g gᵀ` of one gradient g per
    stretch, or what it would be if all stretches erred alike: few gradients scatter little by chance. H is
    the weighted `JᵀJ`, less what Geman-McClure weights (`scale` px) lose of their slope at the distances met.
    How long stretches are depends on who drew the outline: slips are short, the edge of a polygon by hand is
    long. Of several lengths, and of both ways, the one that leaves the most doubt is taken.
    Source: Huber 1981 (M-estimators); Liang and Zeger 1986 (stretches).
    """
    size = matches[0].jacobian.shape[1]
    weights = [robust_weights(found.distances, scale) for found in matches]
    weighted = np.concatenate([m.jacobian * w[:, None] for m, w in zip(matches, weights, strict=True)])
    normal = weighted.T @ np.concatenate([found.jacobian for found in matches])
    inverse = stable_inverse(normal * _curvature(matches, weights, scale))
    grain = GRAIN**2 * weighted.T @ weighted
    tried = [_stretches(pairs, matches, weights, joined) for joined in JOINED]
    spreads = [stretches.scattered() for stretches in tried if stretches.number >= SCATTERING * size]
    spreads += [stretches.alike(scale) for stretches in tried if stretches.number >= ALIKE * size]
    spreads = spreads or [tried[0].alike(scale)]
    candidates: list[FloatArray] = [inverse @ (spread + grain) @ inverse for spread in spreads]
    doubts = [float(np.trace(np.linalg.solve(candidates[0], candidate))) for candidate in candidates]
    return candidates[int(np.argmax(doubts))]


def _curvature(matches: Sequence[Match], weights: Sequence[FloatArray], scale: float) -> float:
    """Share of the weighted `JᵀJ` that Geman-McClure weights leave of the slope at the distances met."""
    squared = (np.nan_to_num(np.concatenate([found.distances for found in matches])) / scale) ** 2
    weight = np.concatenate(weights)
    kept = np.sum(weight * (1.0 - 3.0 * squared) / (1.0 + squared))
    return max(float(kept / max(float(weight.sum()), 1e-300)), LEAST_CURVATURE)


@dataclass(frozen=True, eq=False)
class _Stretches:
    """Sums over each stretch.

    `gradients` (S,P); `lifts` (S,P): what an offset of a pixel adds to them; `distance` (S,), weighted;
    `weight` (S,).
    """

    gradients: FloatArray
    lifts: FloatArray
    distance: FloatArray
    weight: FloatArray

    @property
    def number(self) -> int:
        return len(self.weight)

    def scattered(self) -> FloatArray:
        """Covariance (P,P) of the gradient by the scatter of the stretches' gradients."""
        size = self.gradients.shape[1]
        correction = self.number / (self.number - size)
        scatter: FloatArray = correction * self.gradients.T @ self.gradients
        return scatter

    def alike(self, scale: float) -> FloatArray:
        """Covariance (P,P) of the gradient if all stretches are off with the same variance."""
        spread: FloatArray = self._variance(scale) * self.lifts.T @ self.lifts
        return spread

    def _variance(self, scale: float) -> float:
        """Variance (px²) of what whole stretches are off, from their means and what was usual before.

        A pose that is fitted to few stretches hides most of it: the means' degrees of freedom are counted.
        Source: inverse-gamma prior of a variance; leverages of weighted least squares.
        """
        alike = stable_inverse((self.lifts.T / self.weight) @ self.lifts)
        leverage = np.einsum("si,ij,sj->s", self.lifts, alike, self.lifts)
        usual = float(self.weight.mean())
        freedom = max(float(self.weight.sum() - leverage.sum()) / usual, 0.0)
        squares = float(np.sum(self.distance**2 / self.weight)) / usual
        before: float = USUAL_WORTH * (USUAL_OFFSET * scale) ** 2
        return (before + squares) / (USUAL_WORTH + freedom)


def _stretches(
    pairs: Sequence[ContourPair], matches: Sequence[Match], weights: Sequence[FloatArray], joined: int
) -> _Stretches:
    """Sums over stretches, `joined` of the shortest to one; those without weight are left out."""
    size = matches[0].jacobian.shape[1]
    parts = []
    for pair, found, weight in zip(pairs, matches, weights, strict=True):
        weighted = found.jacobian * weight[:, None]
        distance = np.nan_to_num(found.distances)[:, None]
        columns = np.hstack([weighted * distance, weighted, weight[:, None] * distance, weight[:, None]])
        parts.append(per_stretch(pair.surface.block // joined, columns))
    sums = np.concatenate(parts)
    sums = sums[sums[:, -1] > 0]
    return _Stretches(sums[:, :size], sums[:, size:-2], sums[:, -2], sums[:, -1])


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
