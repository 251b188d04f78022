"""One equation system per region: the photo's moments against those of the projected surface region."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray
from ...geometry.charts import Chart
from ...geometry.moments import (
    boundary_gram,
    edge_moments,
    edge_nodes,
    moment_derivatives,
    moments_from_nodes,
    monomials,
)
from ...geometry.rigid import skew

ORDER = 4
SMOOTHNESS = 0.03  # α of the whitening, in units of the region's spread

Edges = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class MomentPair:
    """Image moments in the region's chart, whitened, and the boundary edges of its surface parts.

    `parts` hold directed edges (E,3) twice, m from the problem's origin, one entry per surface region:
    each is turned to positive area by itself, so its winding does not matter.
    Source: eq. 3.9-3.13, residual `chol(C)⁻¹ (M_surface - M_image)`, C the moments' regularised covariance
    under white boundary noise.
    """

    chart: Chart
    outline: Edges
    moments: FloatArray
    whitening: FloatArray
    parts: tuple[Edges, ...]

    def residuals(self, rotations: FloatArray, translations: FloatArray) -> FloatArray:
        """Whitened moment differences: (K,3,3), (K,3) -> (K,15), NaN where a part is behind the chart."""
        total = np.zeros((len(rotations), len(self.moments)))
        for starts, ends in self.parts:
            a = self.chart.flatten(_moved(starts, rotations, translations))
            b = self.chart.flatten(_moved(ends, rotations, translations))
            part = edge_moments(a, b, ORDER)
            total += np.where(part[:, :1] < 0, -part, part)
        whitened: FloatArray = (total - self.moments) @ self.whitening.T
        return whitened

    def residuals_with_jacobian(
        self, rotations: FloatArray, translations: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """`residuals` and their derivative (K,15,6) to a left turn about the origin (rad) and a shift (m)."""
        total = np.zeros((len(rotations), len(self.moments)))
        slope = np.zeros((len(rotations), len(self.moments), 6))
        for starts, ends in self.parts:
            a, a_rates = self._flattened(starts, rotations, translations)
            b, b_rates = self._flattened(ends, rotations, translations)
            values = monomials(edge_nodes(a, b), ORDER)
            part = moments_from_nodes(values, a, b, ORDER)
            side = np.where(part[:, :1] < 0, -1.0, 1.0)
            total += side * part
            slope += side[..., None] * moment_derivatives(values, a, b, a_rates, b_rates)
        return (total - self.moments) @ self.whitening.T, self.whitening @ slope

    def _flattened(
        self, points: FloatArray, rotations: FloatArray, translations: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Chart coordinates (K,E,2) and their derivatives (K,E,2,6)."""
        turned = points @ np.swapaxes(rotations, 1, 2)
        flat, jacobian = self.chart.flatten_with_jacobian(turned + translations[:, None])
        return flat, np.concatenate([jacobian @ -skew(turned), jacobian], axis=-1)


def moment_pair(chart: Chart, outline: Edges, parts: tuple[Edges, ...]) -> MomentPair:
    """Pair of the photo's outline edges (n,2), (n,2) in the chart and the surface parts' edges."""
    moments = edge_moments(*outline, ORDER)
    gram = boundary_gram(*outline, ORDER, SMOOTHNESS)
    whitening = np.linalg.inv(np.linalg.cholesky(gram))
    return MomentPair(chart, outline, moments, whitening, parts)


def _moved(points: FloatArray, rotations: FloatArray, translations: FloatArray) -> FloatArray:
    """Points (E,3) under K poses: (K,E,3)."""
    moved: FloatArray = points @ np.swapaxes(rotations, 1, 2) + translations[:, None]
    return moved
