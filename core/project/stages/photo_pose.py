"""What became of a photo in the pose stages, and how it is written down between runs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ...cameras import Camera
from ...cameras.files.dictionary import camera_from_dict, camera_to_dict
from ...pose.pose import Pose
from ...pose.regions.region_pose import RegionPose

Method = Literal["edges", "joint"]


@dataclass(frozen=True, eq=False)
class Refinement:
    """One step of refining a pose: the pose it started from, and what it found.

    Scores by `method`: "edges" compares edge agreement (1: none; larger is better), "joint" the median
    distance in pixels to what the other photos show (smaller is better). `count`: edges or ties that hold the
    pose. `note` says why the start was kept; empty when the pose was moved. `lens` tells in words what
    became of the lens where lenses were to be adjusted; `camera` is the one before, where it was. `ties`
    (u, v, du, dv): some ties all over the photo, where the pose puts them, and from there to where they are.
    """

    method: Method
    start: Pose
    score_before: float
    score_after: float
    count: int
    note: str = ""
    lens: str = ""
    camera: Camera | None = None
    ties: tuple[tuple[float, float, float, float], ...] = ()

    @property
    def moved(self) -> bool:
        """Whether the pose was moved."""
        return not self.note


@dataclass(frozen=True, eq=False)
class PointSighting:
    """A known point as picked in a photo: `pixel` and `residual` (observed minus projected), (u, v) pixels.

    `used` tells whether the pose rests on it.
    """

    name: str
    pixel: tuple[float, float]
    residual: tuple[float, float]
    used: bool


@dataclass(frozen=True, eq=False)
class PhotoPose:
    """What became of a photo: its pose, or the sentence that says why it has none.

    `pose` is in the local coordinates of the scan. An ambiguous pose is kept for showing, but `failure` says
    that it does not count. `regions` are the names that were used, `points` the picked points; `notes` tell
    of those that were not. `refinements` are the steps that refined the pose, the first one first; `camera`
    is the photo's as they have adjusted it, None where it is as it was given.
    """

    photo: str
    pose: Pose | None
    failure: str = ""
    regions: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    given: bool = False
    seconds: float = 0.0
    points: tuple[PointSighting, ...] = ()
    refinements: tuple[Refinement, ...] = ()
    camera: Camera | None = None

    @property
    def solved(self) -> bool:
        """Whether the pose can be used."""
        return self.pose is not None and not self.failure

    @property
    def first_pose(self) -> Pose | None:
        """The pose before it was refined."""
        return self.refinements[0].start if self.refinements else self.pose

    @property
    def overlap_error(self) -> float | None:
        """Overlap error δ in percent of the pose from regions; None for any other pose."""
        first = self.first_pose
        return first.overlap_error if isinstance(first, RegionPose) else None

    @property
    def sure_pose(self) -> Pose | None:
        """The pose, if its uncertainty is known; that of a given one is not before it is refined."""
        known = self.pose is not None and bool(np.isfinite(self.pose.covariance).all())
        return self.pose if known else None


def pose_to_dict(result: PhotoPose) -> dict[str, Any]:
    """Plain numbers and texts of a result, as `pose_from_dict` reads them."""
    pose = result.pose
    return {
        "photo": result.photo,
        "pose": None if pose is None else _pose_numbers(pose),
        "failure": result.failure,
        "regions": list(result.regions),
        "notes": list(result.notes),
        "given": result.given,
        "seconds": result.seconds,
        "points": [vars(point) for point in result.points],
        "refinements": [refinement_to_dict(step) for step in result.refinements],
        "camera": _camera_numbers(result.camera),
    }


def pose_from_dict(saved: Mapping[str, Any]) -> PhotoPose:
    """Return the result that `pose_to_dict` wrote down."""
    pose = saved["pose"]
    return PhotoPose(
        saved["photo"],
        None if pose is None else _pose(pose),
        saved["failure"],
        tuple(saved["regions"]),
        tuple(saved["notes"]),
        saved["given"],
        saved["seconds"],
        tuple(_sighting(point) for point in saved["points"]),
        tuple(refinement_from_dict(step) for step in saved["refinements"]),
        _camera(saved.get("camera")),
    )


def refinement_to_dict(step: Refinement) -> dict[str, Any]:
    """Plain numbers and texts of one step of refining."""
    return {**vars(step), "start": _pose_numbers(step.start), "camera": _camera_numbers(step.camera)}


def refinement_from_dict(saved: Mapping[str, Any]) -> Refinement:
    """Return the step that `refinement_to_dict` wrote down."""
    ties = tuple((u, v, du, dv) for u, v, du, dv in saved.get("ties", ()))
    rebuilt = {"start": _pose(saved["start"]), "camera": _camera(saved.get("camera")), "ties": ties}
    return Refinement(**{**saved, **rebuilt})


def _camera_numbers(camera: Camera | None) -> dict[str, Any] | None:
    return None if camera is None else camera_to_dict(camera)


def _camera(numbers: Mapping[str, Any] | None) -> Camera | None:
    return None if numbers is None else camera_from_dict(dict(numbers))


def _sighting(saved: Mapping[str, Any]) -> PointSighting:
    u, v = saved["pixel"]
    du, dv = saved["residual"]
    return PointSighting(saved["name"], (u, v), (du, dv), saved["used"])


def _pose_numbers(pose: Pose) -> dict[str, Any]:
    numbers: dict[str, Any] = {
        name: getattr(pose, name).tolist() for name in ("rotation", "translation", "covariance")
    }
    if isinstance(pose, RegionPose):
        for name in ("overlap_error", "ambiguous", "reason", "locked"):
            numbers[name] = getattr(pose, name)
        errors = pose.region_errors  # JSON knows no NaN
        numbers["region_errors"] = [error if math.isfinite(error) else None for error in errors]
        numbers["remarks"] = list(pose.remarks)
        numbers["alternatives"] = [_pose_numbers(other) for other in pose.alternatives]
    return numbers


def _pose(numbers: Mapping[str, Any]) -> Pose:
    if "overlap_error" in numbers:
        return _region_pose(numbers)
    arrays = {name: np.array(numbers[name]) for name in ("rotation", "translation", "covariance")}
    return Pose(**arrays)


def _region_pose(numbers: Mapping[str, Any]) -> RegionPose:
    return RegionPose(
        rotation=np.array(numbers["rotation"]),
        translation=np.array(numbers["translation"]),
        covariance=np.array(numbers["covariance"]),
        overlap_error=numbers["overlap_error"],
        region_errors=tuple(math.nan if error is None else error for error in numbers["region_errors"]),
        alternatives=tuple(_region_pose(other) for other in numbers["alternatives"]),
        ambiguous=numbers["ambiguous"],
        reason=numbers["reason"],
        locked=numbers["locked"],
        remarks=tuple(numbers["remarks"]),
    )
