"""Which candidates are different poses, and which of them explain the regions as well as the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...arrays import FloatArray, IndexArray
from ...errors import PoseNotFound
from ...geometry.rigid import rotation_angle
from ...settings import PoseSettings
from ..pose import Pose
from .algebraic import Candidates, moment_costs
from .covariance import world_covariance
from .fitting import OutlineFit
from .overlap import overlap_errors
from .problem import Problem
from .region_pose import RegionPose

APART = np.radians(2.0)
"""Poses nearer to each other than this are one."""


ALIKE_SHARE = 0.8
"""Of the best's share of boundary on the outline, what another pose must reach to be its equal."""

EQUAL_SHARE = 0.97
"""The same for being no worse at all, where the side that the faces are wound for decides."""

PLAUSIBLE = 16.0
"""Cost above the best, in its noise variance, up to which another pose explains the regions as well."""

LOOSE = 1.5
"""Degrees of standard deviation from which a pose counts as undecided."""


def chosen(
    problem: Problem, fits: Sequence[OutlineFit], initial: Pose | None, settings: PoseSettings
) -> RegionPose:
    """Choose the best fit, with the others that explain the regions as well.

    Raises
    ------
    PoseNotFound
        Even the best leaves the regions apart.
    """
    rivals = _rivals(problem, fits)
    poses = [posed(problem, fit) for fit in rivals]
    if initial is not None:
        poses.sort(key=lambda pose: float(rotation_angle(pose.rotation @ initial.rotation.T)))
    best, others = poses[0], tuple(poses[1:])
    if best.overlap_error > settings.overlap_limit:
        raise PoseNotFound(
            f"The best pose leaves {best.overlap_error:.0f} % of the regions apart (limit "
            f"{settings.overlap_limit:g} %): check that each region has its right partner and outline."
        )
    if initial is not None or not others:
        loose = best.rotation_sigma > LOOSE
        reason = f"the pose is known to {best.rotation_sigma:.1f} degrees only: add a region" if loose else ""
        return replace(best, alternatives=others, ambiguous=loose, reason=reason)
    reason = f"{len(others)} other pose(s) explain the regions as well: add a region or give the up direction"
    return replace(best, alternatives=others, ambiguous=True, reason=reason)


def _rivals(problem: Problem, fits: Sequence[OutlineFit]) -> list[OutlineFit]:
    """Best fit first, then those about as good; with several regions, poses behind the surface give way."""
    nearest = min(fit.near for fit in fits)
    if nearest < np.inf:
        most = max(fit.share for fit in fits if fit.near == nearest)
        rivals = [fit for fit in fits if fit.near == nearest and fit.share >= ALIKE_SHARE * most]
        rivals.sort(key=lambda fit: -fit.share)
    else:
        rivals = _explaining(problem, fits)
    rivals = _without_repetitions(rivals)
    in_front = [fit for fit in rivals if fit.front]
    if in_front and len(problem.outlines) > 1:
        return in_front
    if nearest == np.inf:
        return rivals
    equal = [fit for fit in rivals if fit.share >= EQUAL_SHARE * rivals[0].share]
    return sorted(equal, key=lambda fit: not fit.front) + rivals[len(equal) :]


def _explaining(problem: Problem, fits: Sequence[OutlineFit]) -> list[OutlineFit]:
    """Fits that explain the moments about as well as the best of them, best first."""
    rotations, translations = np.stack([f.rotation for f in fits]), np.stack([f.translation for f in fits])
    costs = moment_costs(problem.moments, rotations, translations)
    chosen = plausible(costs, problem.equations)
    return [fits[index] for index in chosen[np.argsort(costs[chosen], kind="stable")]]


def _without_repetitions(fits: Sequence[OutlineFit]) -> list[OutlineFit]:
    kept: list[OutlineFit] = []
    for fit in fits:
        if all(rotation_angle(fit.rotation @ other.rotation.T) > APART for other in kept):
            kept.append(fit)
    return kept


def posed(problem: Problem, fit: OutlineFit) -> RegionPose:
    """Pose in the world of a fit, with its overlap."""
    overlap, each = overlap_errors(problem.moments, fit.rotation, fit.translation)
    return RegionPose(
        fit.rotation,
        fit.translation - fit.rotation @ problem.origin,
        world_covariance(fit.covariance, fit.rotation, fit.translation),
        overlap_error=overlap,
        region_errors=each,
        locked=fit.near < np.inf,
    )


def distinct(candidates: Candidates) -> Candidates:
    """Candidates, best first, without repetitions."""
    ordered = candidates.sorted()
    ordered = ordered[np.flatnonzero(np.isfinite(ordered.costs))]
    trace = np.einsum("aij,bij->ab", ordered.rotations, ordered.rotations)
    near = trace > 1.0 + 2.0 * np.cos(APART)  # trace of a rotation: 1 + 2 cos(angle)
    kept: list[int] = []
    for index in range(len(ordered)):
        if not np.any(near[index, kept]):
            kept.append(index)
    return ordered[np.array(kept, dtype=np.int64)]


def unlike(candidates: Candidates, known: Candidates) -> Candidates:
    """Candidates that are not among those known."""
    trace = np.einsum("aij,bij->ab", candidates.rotations, known.rotations)
    return candidates[np.flatnonzero(np.all(trace <= 1.0 + 2.0 * np.cos(APART), axis=1))]


def plausible(costs: FloatArray, equations: int) -> IndexArray:
    """Indices of candidates whose cost exceeds the least by at most PLAUSIBLE of its own noise variance."""
    least = costs.min(initial=np.inf)
    noise = least / max(equations - 6, 1)
    chosen: IndexArray = np.flatnonzero(costs - least <= PLAUSIBLE * noise)
    return chosen
