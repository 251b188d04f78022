"""Which candidates are different poses, and which of them explain the regions as well as the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...arrays import ArrayLike, FloatArray, IndexArray
from ...errors import PoseNotFound
from ...geometry.rigid import log_so3, rotation_angle
from ...regions.image_region import described
from ...settings import PoseSettings
from ..pose import Pose
from .algebraic import Candidates, moment_costs
from .covariance import turn_per_pixel, world_covariance
from .fitting import CLEAN_SHARE, SURE_SHARE, Contours, OutlineFit, finished, fits_without_sides
from .overlap import overlap_errors
from .problem import Problem
from .region_pose import RegionPose

APART = np.radians(2.0)
"""Poses nearer to each other than this are one."""

ALIKE = 0.7
"""Of the best's evidence, what another pose must reach to be its equal."""

CLOSE = 2.0
"""Difference of evidence up to which two poses are equals whatever its size."""

RIVAL = 0.15
"""Least weight of a rival nearby: evidence counts stretches for independent that may not be."""

NO_WORSE = 0.9
"""Of the best's evidence, what a pose must have to be preferred for another reason: it is in front of the
surface, or exact with a side left out."""

ROUGH = np.radians(45.0)
"""Angle up to which a rough pose tells which of several solutions is meant."""

PLAUSIBLE = 16.0
"""Cost above the best, in its noise variance, up to which another pose explains the regions as well."""

ROUND = 60.0
"""Degrees per pixel from which a turn does not show in an outline."""

MISFIT = 8.0
"""Overlap error (%) beyond what even careless drawing leaves: some region shows something else."""

LONELY = 12.0
"""Overlap error (%) of an only region beyond which pieces of its outline may coincide by chance."""

LOOSE = 1.5
"""Degrees of standard deviation from which a pose counts as undecided."""


def chosen(
    contours: Contours,
    fits: Sequence[OutlineFit],
    up: ArrayLike | None,
    initial: Pose | None,
    settings: PoseSettings,
) -> RegionPose:
    """Choose the best fit, with the others that explain the regions as well.

    Raises
    ------
    PoseNotFound
        Even the best leaves the regions apart.
    """
    problem = contours.problem
    locked = fits[0].near < np.inf
    rivals = _rivals(problem, _finished(contours, fits) if locked else fits)
    poses = [posed(problem, fit) for fit in rivals]
    contradicted = ""
    if up is not None:
        poses, contradicted = _upright(poses, np.asarray(up, dtype=np.float64))
    decided = False
    if initial is not None:
        poses, decided = _nearest_first(poses, initial)
    best, others = poses[0], tuple(poses[1:])
    if best.overlap_error > settings.overlap_limit:
        raise PoseNotFound(
            f"The best pose leaves {best.overlap_error:.0f} % of the regions apart (limit "
            f"{settings.overlap_limit:g} %): check that each region has its right partner and outline."
        )
    reason = contradicted or _doubt(problem, best, () if decided else others)
    return replace(best, alternatives=others, ambiguous=bool(reason), reason=reason)


def _upright(poses: Sequence[RegionPose], up: FloatArray) -> tuple[list[RegionPose], str]:
    """Poses in which `up` points up in the photo; if there are none, all of them, and what to say."""
    upright = [pose for pose in poses if pose.rotation[1] @ up < 0]
    said = "" if upright else "the regions fit only with the up direction pointing down: check it"
    return upright or list(poses), said


def _nearest_first(poses: Sequence[RegionPose], initial: Pose) -> tuple[list[RegionPose], bool]:
    """Poses with the one nearest to the rough pose first, if that decides, and whether it does."""
    angles = np.array([float(rotation_angle(pose.rotation @ initial.rotation.T)) for pose in poses])
    order = np.argsort(angles, kind="stable")
    decides = len(poses) > 1 and angles[order[0]] < ROUGH and 2.0 * angles[order[0]] < angles[order[1]]
    return [poses[k] for k in order] if decides else list(poses), decides


def _doubt(problem: Problem, best: RegionPose, others: Sequence[RegionPose]) -> str:
    """Why the regions alone cannot decide, or nothing."""
    if others:
        return (
            f"{len(others)} other pose(s) explain the regions as well: add a region or give the up direction"
        )
    if len(problem.outlines) == 1:
        shift = best.translation + best.rotation @ problem.origin
        if turn_per_pixel(problem.camera, problem.outlines, best.rotation, shift) > ROUND:
            return "the region is so round that a turn of the camera hardly shows: add a region"
    if best.rotation_sigma > LOOSE:
        return f"the pose is known to {best.rotation_sigma:.1f} degrees only: add a region"
    if not best.locked and best.overlap_error > MISFIT:
        return (
            f"{_worst(problem, best)} fits worst and the outlines coincide nowhere: draw the regions more "
            "carefully, check their partners, or mark what hides them"
        )
    if len(problem.outlines) == 1 and best.overlap_error > LONELY:
        return (
            f"the only region leaves {best.overlap_error:.0f} % apart: draw it more carefully, mark what "
            "hides it, or add a region"
        )
    if not best.locked and len(problem.outlines) == 1:
        return (
            "the outlines of the only region coincide nowhere: draw it more carefully, mark what hides it, "
            "or add a region"
        )
    return ""


def _worst(problem: Problem, pose: RegionPose) -> str:
    """The region that overlaps worst, as a message calls it."""
    if not np.any(np.isfinite(pose.region_errors)):
        return "the union of the regions"
    place = int(np.nanargmax(pose.region_errors))
    return described(problem.names[place]).replace("The", "the").replace("Region", "region")


def _finished(contours: Contours, fits: Sequence[OutlineFit]) -> list[OutlineFit]:
    """Fits with about as much evidence as the best, best first; those exact to the pixel if there are any.

    A side of a region may have been drawn beside the true one: where a fit leaves that open, each side is
    left out in turn.
    """
    done = [finished(contours, fit) for fit in _equals(fits)]
    exact = _exact(done)
    found: list[OutlineFit] = []
    for fit in done:
        if fit in exact and (len(contours.problem.outlines) > 1 or fit.share > CLEAN_SHARE):
            found.append(fit)
        elif fit in exact or all(_angle(fit, other) > APART for other in exact):
            itself, others = fits_without_sides(contours, fit)
            near = [other for other in others if _angle(fit, other) <= APART]
            found += [itself, *(other for other in near if _as_good(other, done))]
    found = _exact(found) or found
    finest = min(fit.near for fit in found)
    coarse = [fit for fit in found if fit.near > finest]
    return _equals([fit for fit in found if fit.near == finest]) + _equals(coarse)


def _exact(fits: Sequence[OutlineFit]) -> list[OutlineFit]:
    """Fits exact to the pixel that coincide hardly less than any: straight sides may do so by chance."""
    evidence, share = max(fit.evidence for fit in fits), max(fit.share for fit in fits)
    return [
        fit
        for fit in fits
        if fit.exact and fit.evidence >= NO_WORSE * evidence and fit.share >= NO_WORSE * share
    ]


def _as_good(other: OutlineFit, fits: Sequence[OutlineFit]) -> bool:
    """Whether a fit is no worse than all those of its level, or most of it fits at a finer one."""
    alike = [fit.evidence for fit in fits if fit.near == other.near]
    return other.evidence >= NO_WORSE * max(alike) if alike else other.share > SURE_SHARE


def _equals(fits: Sequence[OutlineFit]) -> list[OutlineFit]:
    """Fits of one level with about as much evidence as the best of them, best first."""
    most = max((fit.evidence for fit in fits), default=0.0)
    least = min(ALIKE * most, most - CLOSE)
    return sorted((fit for fit in fits if fit.evidence >= least), key=lambda fit: -fit.evidence)


def _rivals(problem: Problem, fits: Sequence[OutlineFit]) -> list[OutlineFit]:
    """Best fit first, then those about as good; poses behind the surface give way if they are no better."""
    if fits[0].near == np.inf:
        rivals = _without_repetitions(_explaining(problem, fits))
        in_front = [fit for fit in rivals if fit.front]
        return in_front if in_front and len(problem.outlines) > 1 else rivals
    rivals = _without_repetitions(fits)
    equal = [fit for fit in rivals if fit.evidence >= NO_WORSE * rivals[0].evidence]
    in_front = [fit for fit in equal if fit.front]
    if in_front and len(problem.outlines) > 1:
        return in_front + [fit for fit in rivals if fit not in equal and fit.front]
    return sorted(equal, key=lambda fit: not fit.front) + rivals[len(equal) :]


def _explaining(problem: Problem, fits: Sequence[OutlineFit]) -> list[OutlineFit]:
    """Fits that explain the moments about as well as the best of them, best first."""
    rotations, translations = np.stack([f.rotation for f in fits]), np.stack([f.translation for f in fits])
    costs = moment_costs(problem.moments, rotations, translations)
    chosen = plausible(costs, problem.equations)
    return [fits[index] for index in chosen[np.argsort(costs[chosen], kind="stable")]]


def _without_repetitions(fits: Sequence[OutlineFit]) -> list[OutlineFit]:
    """Distinct poses; a fit near a better one widens its covariance instead, by how likely it is."""
    kept: list[OutlineFit] = []
    for fit in fits:
        near = [k for k, other in enumerate(kept) if _angle(fit, other) <= APART]
        if near:
            kept[near[0]] = _widened(kept[near[0]], fit)
        else:
            kept.append(fit)
    return kept


def _angle(fit: OutlineFit, other: OutlineFit) -> float:
    return float(rotation_angle(fit.rotation @ other.rotation.T))


def _widened(fit: OutlineFit, other: OutlineFit) -> OutlineFit:
    """Fit with the covariance of the mixture of both. Source: moments of a mixture, weights by evidence."""
    if fit.near == np.inf:
        return fit
    step = np.concatenate([log_so3(other.rotation @ fit.rotation.T), other.translation - fit.translation])
    weight = max(1.0 / (1.0 + np.exp(min(fit.evidence - other.evidence, 700.0))), RIVAL)
    return replace(fit, covariance=fit.covariance + weight * np.outer(step, step))


def posed(problem: Problem, fit: OutlineFit) -> RegionPose:
    """Pose in the world of a fit, with its overlap."""
    overlap, each = overlap_errors(problem.moments, fit.rotation, fit.translation)
    return RegionPose(
        fit.rotation,
        fit.translation - fit.rotation @ problem.origin,
        world_covariance(fit.covariance, fit.rotation, fit.translation),
        overlap_error=overlap,
        region_errors=_of_all_regions(problem, each),
        locked=fit.near < np.inf,
    )


def _of_all_regions(problem: Problem, errors: Sequence[float]) -> tuple[float, ...]:
    """Errors of the whole pairs as one per region of the photo, NaN where there is none."""
    everything = np.full(len(problem.names), np.nan)
    if len(problem.names) == len(problem.outlines):
        everything[list(problem.whole)] = errors
    return tuple(everything.tolist())


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
