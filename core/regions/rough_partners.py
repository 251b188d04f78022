"""Which region of the photo is which of the scan, by a pose that is known only roughly.

A rough pose moves all projected regions together: every pair that its uncertainty allows moves it, and the
others then have to lie on each other as well. What is proposed is the most probable of these explanations
(maximum a posteriori: Bishop, Pattern Recognition and Machine Learning, 2006, 1.2.5), with its rivals.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import FloatArray
from ..cameras.base import Camera
from ..errors import RegionError
from ..geometry.moments import edge_moments
from ..geometry.rigid import camera_centre, exp_so3
from ..jobs import Job, Progress
from ..photos.rough_pose import RoughPose
from .image_region import ImageRegion
from .partners import Shapes, partners_at
from .surface_region import SurfaceRegion
from .transfer import project_region

_GATE = 16.0  # squared Mahalanobis distance (3 numbers) up to which a pair is tried: 99.9 % of true ones
_SIZE_SIGMA = 0.1  # deviation of a marked outline's place and size, as a share of the size
_OVERLAP_SIGMA = 0.15  # deviation from 1 of the overlap of true partners, once the pose fits
_LONELY = 8.0  # log odds that a region without partner costs: four deviations of the overlap
_LEAST = 0.4  # overlap from which two regions count as partners
_RIVAL = 5.0  # log odds from which the best explanation is beyond doubt
_ROUNDS = 8  # Gauss-Newton steps; they halve where a region would fall behind the camera
_STEP = 1e-4  # of rotation (rad) and centre (distances) for derivatives


@dataclass(frozen=True, eq=False)
class RoughPairing:
    """Pairs (image region, surface region, overlap 0..1) that a rough pose allows.

    `rotation`, `translation` is the pose that lays them on each other, `deviations` how far that is from the
    rough one, in standard deviations (of 6 numbers: 2.4 are usual), `doubt` the log odds that it is behind
    the best explanation, 0 for that.
    """

    pairs: tuple[tuple[int, int, float], ...]
    rotation: FloatArray
    translation: FloatArray
    deviations: float
    doubt: float


def propose_rough_partners_job(
    camera: Camera,
    poses: Sequence[RoughPose],
    images: Sequence[ImageRegion],
    surfaces: Sequence[SurfaceRegion],
    count: int = 3,
) -> Job[list[RoughPairing]]:
    """Explanations of a photo's regions by the scan's, best first, at most `count`.

    All that are not behind the best beyond doubt. Without any the list is empty: nothing lies where one of
    the rough `poses` (alternatives to each other), with its uncertainty, could see it.
    """
    shapes = Shapes(camera, images)
    seen = [_shape(region.loops) for region in images]
    found: dict[tuple[tuple[int, int], ...], tuple[float, RoughPairing]] = {}
    for number, pose in enumerate(poses):
        search = _Search(camera, pose, surfaces)
        for i, shape in enumerate(seen):
            share = (number + i / len(seen)) / len(poses)
            yield Progress(share, f"Looking where region {i + 1} of {len(seen)} may be")
            for j in search.allowed(shape):
                score, pairing = search.explained(seen, shapes, (i, j))
                key = () if pairing is None else tuple(sorted((a, b) for a, b, _ in pairing.pairs))
                if pairing is not None and score > found.get(key, (-math.inf, None))[0]:
                    found[key] = score, pairing
    ranked = sorted(found.values(), key=lambda entry: -entry[0])
    return [
        _doubted(pairing, ranked[0][0] - score)
        for score, pairing in ranked[:count]
        if score > ranked[0][0] - _RIVAL
    ]


def _doubted(pairing: RoughPairing, doubt: float) -> RoughPairing:
    return RoughPairing(pairing.pairs, pairing.rotation, pairing.translation, pairing.deviations, doubt)


class _Search:
    """A rough pose and the scan's regions around it. Offsets (6,) are as in the covariance of `RoughPose`."""

    def __init__(self, camera: Camera, pose: RoughPose, surfaces: Sequence[SurfaceRegion]) -> None:
        self.camera, self.rotation, self.surfaces = camera, pose.rotation, surfaces
        self.centre = camera_centre(pose.rotation, pose.translation)
        self.covariance, self.information = pose.covariance, np.linalg.inv(pose.covariance)

    def allowed(self, shape: FloatArray) -> list[int]:
        """Surface regions that may be seen as a shape (3,)."""
        allowed = []
        for j, (expected, spread) in self._expected.items():
            gap = self._gap(shape, expected)
            if gap @ np.linalg.solve(spread + _noise(shape), gap) < _GATE:
                allowed.append(j)
        return allowed

    @cached_property
    def _expected(self) -> dict[int, tuple[FloatArray, FloatArray]]:
        """Shapes (3,) that the rough pose expects of the regions before it, and their covariances (3,3)."""
        expected = {}
        for j in range(len(self.surfaces)):
            try:
                shape, rows = self._linearised(j, np.zeros(6))
            except RegionError:  # not before the camera
                continue
            expected[j] = shape, rows @ self.covariance @ rows.T
        return expected

    def explained(
        self, seen: Sequence[FloatArray], shapes: Shapes, first: tuple[int, int]
    ) -> tuple[float, RoughPairing | None]:
        """Score (log odds) of the explanation that a first pair leads to, and the explanation."""
        offset, pairs = self._fitted([(first, seen[first[0]])]), [first]
        for _ in range(2):  # with the partners that the first one brings, then with those they bring
            if offset is None:
                return -math.inf, None
            found = partners_at(self.camera, *self._pose(offset), shapes, self.surfaces, _LEAST)
            again = sorted((i, j) for i, j, _ in found)
            if not again or again == sorted(pairs):
                break
            pairs = again
            offset = self._fitted([(pair, seen[pair[0]]) for pair in pairs])
        if offset is None:
            return -math.inf, None
        found = partners_at(self.camera, *self._pose(offset), shapes, self.surfaces, _LEAST)
        if not found:
            return -math.inf, None
        squared = float(offset @ self.information @ offset)
        lonely = _LONELY * (len(seen) - len(found))
        misfit = 0.5 * sum(((1 - share) / _OVERLAP_SIGMA) ** 2 for _, _, share in found)
        pairing = RoughPairing(tuple(found), *self._pose(offset), math.sqrt(squared), 0.0)
        return -0.5 * squared - misfit - lonely, pairing

    def _pose(self, offset: FloatArray) -> tuple[FloatArray, FloatArray]:
        rotation = exp_so3(offset[:3]) @ self.rotation
        return rotation, -rotation @ (self.centre + offset[3:])

    def _shape_at(self, number: int, offset: FloatArray) -> FloatArray:
        return _shape(project_region(self.camera, *self._pose(offset), self.surfaces[number]))

    def _gap(self, shape: FloatArray, expected: FloatArray) -> FloatArray:
        """Difference of shapes (3,), over the seam of a panorama if that is shorter."""
        near = self.camera.unwrapped(shape[:2], expected[:2])
        return np.array([*(near - expected[:2]), shape[2] - expected[2]])

    def _linearised(self, number: int, offset: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Shape (3,) of a projected region and its derivatives (3,6)."""
        away = float(np.linalg.norm(self.surfaces[number].centre - self.centre - offset[3:]))
        steps = _STEP * np.array([1, 1, 1, away, away, away])
        here = self._shape_at(number, offset)
        columns = [(self._shape_at(number, offset + step) - here) / step.sum() for step in np.diag(steps)]
        return here, np.stack(columns, axis=1)

    def _fitted(self, pairs: Sequence[tuple[tuple[int, int], FloatArray]]) -> FloatArray | None:
        """Most probable offset (6,) with which regions are seen as shapes, by Gauss-Newton steps.

        None where they are not before the camera.
        """
        offset = np.zeros(6)
        for _ in range(_ROUNDS):
            step = self._step(pairs, offset)
            if step is None:
                return None
            offset = offset + step
            if np.sqrt(step @ self.information @ step) < 0.01:
                break
        return offset

    def _step(
        self, pairs: Sequence[tuple[tuple[int, int], FloatArray]], offset: FloatArray
    ) -> FloatArray | None:
        normal, right = self.information.copy(), -self.information @ offset
        try:
            for (_, j), shape in pairs:
                expected, rows = self._linearised(j, offset)
                weighted = rows.T @ np.linalg.inv(_noise(shape))
                normal += weighted @ rows
                right += weighted @ self._gap(shape, expected)
            step: FloatArray = np.linalg.solve(normal, right)
            return next(
                (
                    share * step
                    for share in (1.0, 0.5, 0.25, 0.125)
                    if self._all_before(pairs, offset + share * step)
                ),
                None,
            )
        except RegionError:
            return None

    def _all_before(self, pairs: Sequence[tuple[tuple[int, int], FloatArray]], offset: FloatArray) -> bool:
        try:
            for (_, j), _ in pairs:
                self._shape_at(j, offset)
        except RegionError:
            return False
        return True


def _shape(loops: Sequence[FloatArray]) -> FloatArray:
    """Centre (u, v) in pixels and logarithm of the size (root of the area) of closed loops: (3,)."""
    starts = np.concatenate(loops)
    ends = np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])
    middle = starts.mean(axis=0)
    area, u, v = edge_moments(starts - middle, ends - middle, 1)
    if not area > 0:
        raise RegionError("The region is seen edge-on.")
    return np.array([*(middle + np.array([u, v]) / area), 0.5 * math.log(area)])


def _noise(shape: FloatArray) -> FloatArray:
    """Covariance (3,3) of a marked region's shape (3,)."""
    size = _SIZE_SIGMA * math.exp(shape[2])
    return np.diag([size * size, size * size, _SIZE_SIGMA**2])
