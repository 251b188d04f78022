"""What is told of regions: which do not fit the others, and which nothing else could contradict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...errors import PoseNotFound
from ...jobs import Job, Progress
from ...regions.image_region import described
from .ambiguity import MISFIT
from .contour import match
from .fitting import LEVELS, Contours, few_sides
from .problem import Problem
from .region_pose import RegionPose

UNCONTRADICTED = (
    "The only region has so few sides that one of them, drawn beside the true edge, would not show: the pose "
    "is as good as the outline; add a region to be sure."
)

Solver = Callable[[Problem], Job[RegionPose]]


def pose_without_misfit(problem: Problem, solve: Solver) -> Job[RegionPose | None]:
    """Pose from all regions but one, where leaving that one out lets the others lock; None if none does.

    Of several such regions the one is left out without which more of all outlines coincides: what is seen
    of a partly hidden region still lies on its boundary.
    """
    best: tuple[float, RegionPose] | None = None
    for place in range(len(problem.moments)) if len(problem.moments) > 1 else ():
        yield Progress(0.9, "Looking for a region that does not fit the others")
        try:
            pose = yield from _quietly(solve(problem.without(place)))
        except PoseNotFound:
            continue
        shares = _shares(problem, pose)
        if pose.locked and not pose.ambiguous and (best is None or sum(shares) > best[0]):
            left_out = problem.whole[place]
            best = (sum(shares), replace(pose, remarks=(_remark(problem, left_out, shares[left_out]),)))
    return None if best is None else best[1]


def misfits_told(problem: Problem, pose: RegionPose) -> RegionPose:
    """Pose with a remark on every region that overlaps badly while the outlines of the others coincide.

    An only region of few straight sides, one of them drawn elsewhere, is another view of itself: then the
    remark says what the standard deviations cannot know.
    """
    shift = pose.translation + pose.rotation @ problem.origin
    if pose.locked and not pose.ambiguous and few_sides(Contours(problem), pose.rotation, shift):
        return replace(pose, remarks=(UNCONTRADICTED,))
    errors = np.nan_to_num(np.array(pose.region_errors))
    bad = np.flatnonzero(errors > MISFIT) if pose.locked else np.zeros(0, dtype=np.int64)
    if len(bad) in (0, len(problem.outlines)):
        return pose
    remarks = tuple(
        f"{described(problem.names[place])} leaves {errors[place]:.0f} % apart where the others fit: it is "
        "partly hidden, or its partner on the scan is another; mark what hides it."
        for place in bad
    )
    return replace(pose, remarks=remarks)


def _quietly(job: Job[RegionPose]) -> Job[RegionPose]:
    """Job that keeps its own progress to itself, as it is one of several."""
    while True:
        try:
            next(job)
        except StopIteration as stop:
            pose: RegionPose = stop.value
            return pose
        yield Progress(0.9, "Looking for a region that does not fit the others")


def _shares(problem: Problem, pose: RegionPose) -> list[float]:
    """Share of every pair's boundary that lies on the outline, within what care in drawing allows."""
    shift = pose.translation + pose.rotation @ problem.origin
    pairs = Contours(problem).pairs(LEVELS[1], pose.rotation, shift)
    found = [match(problem.camera, pair, pose.rotation, shift).distances for pair in pairs]
    return [float(np.mean(np.abs(distances) < LEVELS[1].near)) for distances in found]


def _remark(problem: Problem, place: int, share: float) -> str:
    return (
        f"{described(problem.names[place])} fits the others over {100 * share:.0f} % of its outline only and "
        "was left out: it is partly hidden, or its partner on the scan is another; mark what hides it."
    )
