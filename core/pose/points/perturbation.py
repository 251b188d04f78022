"""Small changes of a pose, in the coordinates of `Pose.covariance`, and the solver that makes them.

A step is (w, d): rotation `exp(w) R` (rad, camera axes) and camera centre `c + d` (m, world axes). Camera
points are formed as `R (X - c)`, so that coordinates of thousands of kilometres lose no digits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ...arrays import FloatArray
from ...geometry.rigid import exp_so3, skew

Linearisation: TypeAlias = tuple[FloatArray, FloatArray]
"""Whitened residuals (N,K) and their derivative (N,K,6) with respect to the step."""


@dataclass(frozen=True, eq=False)
class PoseFit:
    """A minimum found: `hessian` (6,6) is the weighted normal matrix, `weights` (N,) the last ones."""

    rotation: FloatArray
    centre: FloatArray
    hessian: FloatArray
    residuals: FloatArray
    weights: FloatArray
    cost: float


def step_pose(rotation: FloatArray, centre: FloatArray, step: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Apply a step (6,) to a rotation (3,3) and a camera centre (3,)."""
    return exp_so3(step[:3]) @ rotation, centre + step[3:]


def camera_points(rotation: FloatArray, centre: FloatArray, points: FloatArray) -> FloatArray:
    """World points in the camera frame: (N,3) -> (N,3)."""
    out: FloatArray = (points - centre) @ rotation.T
    return out


def camera_point_jacobian(rotation: FloatArray, in_camera: FloatArray) -> FloatArray:
    """Derivative of camera points with respect to the step: (N,3) camera frame -> (N,3,6)."""
    out = np.empty((len(in_camera), 3, 6))
    out[:, :, :3] = -skew(in_camera)
    out[:, :, 3:] = -rotation
    return out


def cauchy(squared: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
    """Cauchy loss of squared residuals (N,): values and weights, both (N,)."""
    ratio = squared / scale**2
    return scale**2 * np.log1p(ratio), 1.0 / (1.0 + ratio)


def minimise_pose(
    rotation: FloatArray,
    centre: FloatArray,
    linearise: Callable[[FloatArray, FloatArray], Linearisation],
    scale: float = np.inf,
    iterations: int = 30,
) -> PoseFit:
    """Levenberg–Marquardt on a pose with a Cauchy loss of width `scale` (inf: least squares).

    `linearise(rotation, centre)` gives whitened residuals (N,K) and their derivative (N,K,6); the loss acts
    on the length of each row. Source: Marquardt 1963; iteratively reweighted least squares.
    """

    def measure(r: FloatArray) -> tuple[float, FloatArray]:
        squared = np.einsum("nk,nk->n", r, r)
        if np.isinf(scale):
            return float(squared.sum()), np.ones(len(r))
        values, weights = cauchy(squared, scale)
        return float(values.sum()), weights

    residuals, jacobian = linearise(rotation, centre)
    cost, weights = measure(residuals)
    damping = 1e-4
    for _ in range(iterations):
        hessian, gradient = normal_equations(residuals, jacobian, weights)
        step = -solve_scaled(hessian, gradient, damping)
        trial = step_pose(rotation, centre, step)
        trial_residuals, trial_jacobian = linearise(*trial)
        trial_cost, trial_weights = measure(trial_residuals)
        if trial_cost >= cost:
            damping = max(damping, 1e-7) * 10
            if damping > 1e8:
                break
            continue
        gain = cost - trial_cost
        rotation, centre = trial
        residuals, jacobian = trial_residuals, trial_jacobian
        cost, weights, damping = trial_cost, trial_weights, damping * 0.1
        if gain < 1e-10 * cost + 1e-20:
            break
    hessian, _ = normal_equations(residuals, jacobian, weights)
    return PoseFit(rotation, centre, hessian, residuals, weights, cost)


def normal_equations(
    residuals: FloatArray, jacobian: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Weighted normal matrix (6,6) and gradient (6,) of residuals (N,K), derivative (N,K,6), weights (N,)."""
    flat = jacobian.reshape(-1, 6)
    weighted: FloatArray = flat * np.repeat(weights, jacobian.shape[1])[:, None]
    hessian: FloatArray = flat.T @ weighted
    gradient: FloatArray = weighted.T @ residuals.ravel()
    return hessian, gradient


def solve_scaled(hessian: FloatArray, gradient: FloatArray, damping: float = 0.0) -> FloatArray:
    """Solve a damped normal system after scaling its diagonal to one; singular directions stay at zero."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    scaled = hessian * np.outer(scale, scale) + damping * np.eye(len(scale))
    solution: FloatArray = scale * np.linalg.lstsq(scaled, scale * gradient, rcond=1e-14)[0]
    return solution


def invert_scaled(hessian: FloatArray) -> FloatArray:
    """Inverse of a positive definite matrix (K,K) whose rows have very different units."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    scaled = hessian * np.outer(scale, scale)
    inverse: FloatArray = np.linalg.pinv(scaled, rcond=1e-13, hermitian=True)
    out: FloatArray = inverse * np.outer(scale, scale)
    symmetric: FloatArray = 0.5 * (out + out.T)
    return symmetric
