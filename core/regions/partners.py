"""Which region of the photo is which of the scan: by a rough pose, or by trying.

Nothing here is taken without asking: every proposal carries its score.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from ..arrays import ArrayLike
from ..cameras.base import Camera
from ..errors import FrescoError, RegionError
from ..jobs import Job, Progress
from .image_region import ImageRegion
from .surface_region import SurfaceRegion
from .transfer import overlap, project_region


class _Solved(Protocol):
    @property
    def overlap_error(self) -> float: ...


@dataclass(frozen=True, eq=False)
class PairingProposal:
    """Which surface region may belong to which image region: index pairs, and the pose that they give.

    `error` is the overlap error in percent: the smaller the better.
    """

    pairs: tuple[tuple[int, int], ...]
    error: float
    pose: object


def propose_partners(
    camera: Camera,
    rotation: ArrayLike,
    translation: ArrayLike,
    image_regions: Sequence[ImageRegion],
    surface_regions: Sequence[SurfaceRegion],
    least_overlap: float = 0.3,
) -> list[tuple[int, int, float]]:
    """Partners by projecting with a rough pose: (image region, surface region, overlap 0..1), best first.

    Every region is used once at most.
    """
    candidates = []
    for j, surface in enumerate(surface_regions):
        try:
            projected = ImageRegion(project_region(camera, rotation, translation, surface))
        except RegionError:  # behind the camera: no partner in this photo
            continue
        for i, region in enumerate(image_regions):
            share = overlap(region, projected, camera)
            if share >= least_overlap:
                candidates.append((i, j, share))
    chosen: list[tuple[int, int, float]] = []
    for i, j, share in sorted(candidates, key=lambda entry: -entry[2]):
        if all(i != a and j != b for a, b, _ in chosen):
            chosen.append((i, j, share))
    return chosen


def propose_pairings_job(
    solve: Callable[[Sequence[ImageRegion], Sequence[SurfaceRegion]], _Solved],
    image_regions: Sequence[ImageRegion],
    surface_regions: Sequence[SurfaceRegion],
    count: int = 5,
    limit: int = 200,
) -> Job[list[PairingProposal]]:
    """Pairings without a pose.

    Combinations of two regions, each solved and scored; the best `count` to choose from.

    `solve` is the pose solver, called with paired regions; it raises FrescoError where a pairing cannot be.
    More than `limit` combinations are refused: the user has to choose fewer regions.
    """
    images, surfaces = range(len(image_regions)), range(len(surface_regions))
    together = min(2, len(images), len(surfaces))
    if together == 0:
        raise RegionError("Mark regions in the photo and on the scan first.")
    trials = [
        tuple(zip(some, others, strict=True))
        for some in itertools.combinations(images, together)
        for others in itertools.permutations(surfaces, together)
    ]
    if len(trials) > limit:
        raise RegionError(
            f"{len(trials)} combinations are too many to try: choose at most four regions in the photo "
            "and on the scan."
        )
    proposals = []
    for number, pairs in enumerate(trials):
        yield Progress(number / len(trials), f"Trying pairing {number + 1} of {len(trials)}")
        try:
            pose = solve([image_regions[i] for i, _ in pairs], [surface_regions[j] for _, j in pairs])
        except FrescoError:  # this pairing has no pose, which is what the trial was to tell
            continue
        proposals.append(PairingProposal(pairs, pose.overlap_error, pose))
    return sorted(proposals, key=lambda proposal: proposal.error)[:count]
