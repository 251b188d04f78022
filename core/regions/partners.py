"""Which region of the photo is which of the scan, without a pose: by trying.

Nothing here is taken without asking: every proposal carries its score.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..arrays import ArrayLike, BoolArray, FloatArray
from ..cameras.base import Camera
from ..errors import FrescoError, RegionError
from ..geometry.outlines import fill_loops
from ..jobs import Job, Progress
from .image_region import ImageRegion
from .photo.edges import to_reduced
from .surface_region import SurfaceRegion
from .transfer import project_region

_GRID = 400  # pixels of the longer side at which regions are compared
_LEAST = 0.5  # overlap from which two regions speak for a guessed pose
_MOST_PAIRS = 100  # single pairs that are tried: some 0.2 s each


class _Solved(Protocol):
    """What the pose solver gives; see `pose.regions.region_pose.RegionPose`."""

    @property
    def rotation(self) -> FloatArray: ...
    @property
    def translation(self) -> FloatArray: ...
    @property
    def overlap_error(self) -> float: ...
    @property
    def alternatives(self) -> Sequence[_Solved]: ...


@dataclass(frozen=True, eq=False)
class PairingProposal:
    """Which surface region may belong to which image region: index pairs, and the pose that they give.

    `error` is the overlap error in percent: the smaller the better.
    """

    pairs: tuple[tuple[int, int], ...]
    error: float
    pose: _Solved


class Shapes:
    """Masks of a photo's regions on a coarse grid, to compare projected regions with."""

    def __init__(self, camera: Camera, regions: Sequence[ImageRegion]) -> None:
        self.factor = min(1.0, _GRID / max(camera.width, camera.height))
        self.size = max(1, round(camera.width * self.factor)), max(1, round(camera.height * self.factor))
        self.masks = [self._mask(region.loops) for region in regions]
        self.areas = [np.count_nonzero(mask) for mask in self.masks]

    def _mask(self, loops: Sequence[FloatArray]) -> BoolArray:
        return fill_loops([to_reduced(loop, self.factor) for loop in loops], *self.size)

    def overlaps(self, loops: Sequence[FloatArray]) -> list[float]:
        """Intersection over union of closed loops (n,2) with every region."""
        other = self._mask(loops)
        area = np.count_nonzero(other)
        both = [np.count_nonzero(mask & other) for mask in self.masks]
        return [shared / max(area + own - shared, 1) for shared, own in zip(both, self.areas, strict=True)]


def partners_at(
    camera: Camera,
    rotation: ArrayLike,
    translation: ArrayLike,
    shapes: Shapes,
    surfaces: Sequence[SurfaceRegion],
    least: float,
) -> list[tuple[int, int, float]]:
    """Partners at a pose: (image region, surface region, overlap 0..1), best first.

    Every region is used once at most; `least` is the overlap that partners need.
    """
    candidates = []
    for j, surface in enumerate(surfaces):
        try:
            loops = project_region(camera, rotation, translation, surface)
        except RegionError:  # behind the camera: no partner in this photo
            continue
        shares = shapes.overlaps(loops)
        candidates += [(i, j, share) for i, share in enumerate(shares) if share >= least]
    chosen: list[tuple[int, int, float]] = []
    for i, j, share in sorted(candidates, key=lambda entry: -entry[2]):
        if all(i != a and j != b for a, b, _ in chosen):
            chosen.append((i, j, share))
    return chosen


Solver = Callable[[Sequence[ImageRegion], Sequence[SurfaceRegion]], _Solved]


def propose_pairings_job(
    camera: Camera,
    solve: Solver,
    image_regions: Sequence[ImageRegion],
    surface_regions: Sequence[SurfaceRegion],
    count: int = 5,
) -> Job[list[PairingProposal]]:
    """Pairings without a pose: the `count` best to choose from, those of most regions first.

    Every single pair is solved; each pose that it gives is a guess, which the other regions that it lays on
    each other speak for. The guesses with most overlap are solved again with all their pairs.
    `solve` is the pose solver, called with paired regions; it raises FrescoError where a pairing cannot be.

    Raises
    ------
    RegionError
        No regions, or more than 100 pairs of one.
    """
    singles = list(itertools.product(range(len(image_regions)), range(len(surface_regions))))
    if not singles:
        raise RegionError("Mark regions in the photo and on the scan first.")
    if len(singles) > _MOST_PAIRS:
        raise RegionError(
            f"{len(singles)} pairs are too many to try: choose at most ten regions on either side."
        )
    shapes = Shapes(camera, image_regions)
    guesses: dict[tuple[tuple[int, int], ...], tuple[float, PairingProposal]] = {}
    for number, (i, j) in enumerate(singles):
        yield Progress(0.8 * number / len(singles), f"Trying pair {number + 1} of {len(singles)}")
        pose = _solved(solve, [image_regions[i]], [surface_regions[j]])
        for guess in (pose, *pose.alternatives) if pose else ():
            found = partners_at(camera, guess.rotation, guess.translation, shapes, surface_regions, _LEAST)
            pairs = tuple(sorted((a, b) for a, b, _ in found)) or ((i, j),)
            support = sum(share for _, _, share in found)
            if support > guesses.get(pairs, (0.0, None))[0]:
                guesses[pairs] = support, PairingProposal(pairs, guess.overlap_error, guess)
    best = sorted(guesses.values(), key=lambda entry: -entry[0])[: 2 * count]
    proposals = []
    for number, (_, proposal) in enumerate(best):
        yield Progress(0.8 + 0.2 * number / len(best), f"Comparing pairing {number + 1} of {len(best)}")
        proposals += _together(solve, image_regions, surface_regions, proposal)
    return sorted(proposals, key=lambda proposal: (-len(proposal.pairs), proposal.error))[:count]


def _together(
    solve: Solver,
    images: Sequence[ImageRegion],
    surfaces: Sequence[SurfaceRegion],
    proposal: PairingProposal,
) -> list[PairingProposal]:
    """Solve a guess with all its pairs; nothing where they have no pose together."""
    if len(proposal.pairs) == 1:
        return [proposal]
    pose = _solved(solve, [images[i] for i, _ in proposal.pairs], [surfaces[j] for _, j in proposal.pairs])
    return [PairingProposal(proposal.pairs, pose.overlap_error, pose)] if pose else []


def _solved(
    solve: Solver, images: Sequence[ImageRegion], surfaces: Sequence[SurfaceRegion]
) -> _Solved | None:
    try:
        return solve(images, surfaces)
    except FrescoError:  # this pairing has no pose, which is what the trial was to tell
        return None
