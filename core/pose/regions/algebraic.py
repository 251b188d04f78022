"""Levenberg-Marquardt on the moment equations, many starts at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray, IndexArray
from ...geometry.rigid import exp_so3
from .moment_pair import MomentPair


@dataclass(frozen=True, eq=False)
class Candidates:
    """K poses `X_cam = rotation @ X + translation`, X (m) from the problem's origin, and their costs (K,)."""

    rotations: FloatArray
    translations: FloatArray
    costs: FloatArray

    def __len__(self) -> int:
        return len(self.rotations)

    def __getitem__(self, chosen: IndexArray | slice) -> Candidates:
        return Candidates(self.rotations[chosen], self.translations[chosen], self.costs[chosen])

    def sorted(self) -> Candidates:
        """The same candidates, best first."""
        return self[np.argsort(self.costs)]


def joined(several: Sequence[Candidates]) -> Candidates:
    """All candidates in one list."""
    return Candidates(
        np.concatenate([c.rotations for c in several]),
        np.concatenate([c.translations for c in several]),
        np.concatenate([c.costs for c in several]),
    )


def moment_costs(pairs: Sequence[MomentPair], rotations: FloatArray, translations: FloatArray) -> FloatArray:
    """Sum of squared whitened residuals: (K,3,3), (K,3) -> (K,), infinite where a pose is impossible."""
    costs = np.zeros(len(rotations))
    for pair in pairs:
        residual = pair.residuals(rotations, translations)
        costs += np.sum(residual * residual, axis=1)
    return np.where(np.isfinite(costs), costs, np.inf)


def refine_by_moments(
    pairs: Sequence[MomentPair], starts: Candidates, iterations: int, tolerance: float = 1e-10
) -> Candidates:
    """Levenberg-Marquardt from every start at once, 6 parameters each. Source: eq. 3.13; Marquardt 1963."""
    rotations, translations = starts.rotations.copy(), starts.translations.copy()
    normal, gradient, costs = _normal_equations(pairs, rotations, translations)
    damping = np.full(len(rotations), 1e-3)
    active = np.isfinite(costs)
    for _ in range(iterations):
        chosen = np.flatnonzero(active)
        if len(chosen) == 0:
            break
        step = _damped_steps(normal[chosen], gradient[chosen], damping[chosen])
        new_rotations = exp_so3(step[:, :3]) @ rotations[chosen]
        new_translations = translations[chosen] + step[:, 3:]
        new_normal, new_gradient, new_costs = _normal_equations(pairs, new_rotations, new_translations)
        better = new_costs < costs[chosen]
        moved = chosen[better]
        small = costs[moved] - new_costs[better] <= tolerance * costs[moved]
        rotations[moved], translations[moved] = new_rotations[better], new_translations[better]
        normal[moved], gradient[moved] = new_normal[better], new_gradient[better]
        costs[moved] = new_costs[better]
        damping[moved] *= 0.1
        damping[chosen[~better]] *= 10.0
        active[moved[small]] = False
        active &= damping < 1e6
    return Candidates(rotations, translations, costs)


def _normal_equations(
    pairs: Sequence[MomentPair], rotations: FloatArray, translations: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """`JᵀJ` (K,6,6), `Jᵀr` (K,6) and costs (K,) over all pairs."""
    count = len(rotations)
    normal, gradient, costs = np.zeros((count, 6, 6)), np.zeros((count, 6)), np.zeros(count)
    for pair in pairs:
        residual, jacobian = pair.residuals_with_jacobian(rotations, translations)
        transposed = np.swapaxes(jacobian, 1, 2)
        normal += transposed @ jacobian
        gradient += (transposed @ residual[..., None])[..., 0]
        costs += np.sum(residual * residual, axis=1)
    bad = ~np.isfinite(costs)
    normal[bad], gradient[bad], costs[bad] = np.eye(6), 0.0, np.inf
    return normal, gradient, costs


def _damped_steps(normal: FloatArray, gradient: FloatArray, damping: FloatArray) -> FloatArray:
    """Marquardt steps (K,6)."""
    diagonal = np.einsum("kii->ki", normal)
    floor = 1e-12 * diagonal.max(axis=1, keepdims=True) + 1e-300
    damped = normal + (damping[:, None] * diagonal + floor)[:, :, None] * np.eye(6)
    step: FloatArray = -np.linalg.solve(damped, gradient[..., None])[..., 0]
    return step
