"""Poses that fit the moments of all regions, sought from starts on single ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...errors import PoseNotFound
from ..pose import Pose
from .algebraic import Candidates, joined, moment_costs, refine_by_moments
from .ambiguity import distinct
from .initial import starting_poses
from .moment_pair import MomentPair
from .problem import Problem

MOST = 8
"""Candidates kept per region, and over all."""

MOST_FITTED = 4
"""Candidates whose outlines are fitted."""

HOPELESS = 100.0
"""Times the best cost after a few steps, from which a candidate is not followed."""

NOWHERE = "No camera position sees all regions at once: check that each has its right partner."


def moment_candidates(
    problem: Problem, sketches: Sequence[MomentPair], initial: Pose | None = None
) -> Candidates:
    """Distinct poses that fit the moments, best first, from starts on some of the regions.

    Raises
    ------
    PoseNotFound
        There is none.
    """
    found = []
    for pair in sketches:
        for part in pair.parts:
            starts = starting_poses(pair.chart, pair.outline, part)
            found.append(refine_by_moments([pair], starts, 8).sorted()[: 2 * MOST])
    if initial is not None:
        shifted = initial.rotation @ problem.origin + initial.translation
        found.append(Candidates(np.asarray(initial.rotation)[None], shifted[None], np.zeros(1)))
    several = joined(found)
    costs = moment_costs(problem.coarse, several.rotations, several.translations)
    several = distinct(Candidates(several.rotations, several.translations, costs))[:MOST]
    if len(several) == 0:
        raise PoseNotFound(NOWHERE)
    fitted = distinct(refine_by_moments(problem.coarse, several, 5))
    fitted = fitted[np.flatnonzero(fitted.costs < HOPELESS * fitted.costs[0])][:MOST_FITTED]
    exact = distinct(refine_by_moments(problem.moments, fitted, 20))
    if len(exact) == 0:
        raise PoseNotFound(NOWHERE)
    return exact
