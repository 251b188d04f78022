"""How sure a pose from regions is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import FloatArray
from ...geometry.rigid import skew
from .moment_pair import MomentPair


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


def stable_inverse(normal: FloatArray) -> FloatArray:
    """Inverse of a positive normal matrix whose parameters have different units."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal * np.outer(scale, scale)
    inverse: FloatArray = np.linalg.inv(scaled + 1e-12 * np.eye(len(normal))) * np.outer(scale, scale)
    return inverse


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
