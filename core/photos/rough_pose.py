"""Poses that are known roughly, by other means than the photo's content, and how roughly.

Rotation and translation are world to camera; a covariance (6,6) has the order and units of `pose.Pose`: left
perturbation exp(w) R in rad, then the camera centre in metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..arrays import ArrayLike, FloatArray
from ..errors import PhotoError
from ..geometry.rigid import camera_centre
from .georeference import Georeference
from .position import Direction, Position

_STEP = 0.25  # share of the distance to the scan by which the next photo's centre may differ
_NEXT_HEADING, _NEXT_PITCH, _NEXT_ROLL = 12.0, 8.0, 3.0  # degrees by which the next photo may be turned
_KNOWN, _BY_HAND = (0.5, 0.01), (3.0, 0.05)  # degrees and share of the distance
_LEAST_TURN = 15.0  # degrees: a photo of the scan need not show its middle in its middle
_FAR = 20_000.0  # m: no photo shows a scan from there
_STEEPEST = 10.0  # of height by distance, as far as a photo looks down at what it shows
_MOST_TURN = 60.0  # degrees: from here on the direction to the scan tells nothing


@dataclass(frozen=True, eq=False)
class RoughPose:
    """A pose (3,3), (3,) m with its covariance (6,6), and where it is from, as a message says it."""

    rotation: FloatArray
    translation: FloatArray
    covariance: FloatArray
    source: str

    @property
    def said(self) -> str:
        """How sure it is: the mean deviations per axis."""
        metres = math.sqrt(np.trace(self.covariance[3:, 3:]) / 3)
        degrees = math.degrees(math.sqrt(np.trace(self.covariance[:3, :3]) / 3))
        return f"{self.source}, ± {metres:.2g} m, ± {degrees:.2g}°"


def pose_from_position(position: Position, world: Georeference, bounds: ArrayLike) -> RoughPose:
    """Rough pose of a photo by its position; `bounds` (2,3), m, are the scan's least and largest coordinates.

    Without a direction it looks at the scan. Its height is where position and scan agree: photos that look
    level are taken about as high as what they show, and heights of different systems may be far apart.

    Raises
    ------
    PhotoError
        The photo stands within the scan and tells no direction, or far away.
    """
    box = np.asarray(bounds, dtype=np.float64)
    plane, across = world.place(position)
    away = float(np.linalg.norm(plane - box[:, :2].mean(axis=0)))
    if not away < _FAR:
        raise PhotoError(
            f"The photo's position lies {away / 1000:,.0f} km from the scan: check the EPSG code (step 1)."
        )
    height, height_variance = _height(position, world, box, away)
    centre = np.array([*plane, height])
    direction, source = position.direction, "position and direction in the photo"
    if direction is None:
        direction, source = _towards(centre, box, position.held), "position in the photo, looking at the scan"
        heading, turn_sigma = math.radians(direction.heading), 0.0
    else:
        heading, turn_sigma = world.heading(position, direction.heading), world.turn_sigma
    rotation = _rotation(heading, direction)
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = _turn_covariance(rotation, direction, turn_sigma)
    covariance[3:5, 3:5], covariance[5, 5] = across, height_variance
    return RoughPose(rotation, -rotation @ centre, covariance, source)


def pose_like_neighbour(
    rotation: ArrayLike, translation: ArrayLike, bounds: ArrayLike, name: str
) -> RoughPose:
    """Rough pose of a photo taken next to another one: as that one's, to a quarter of its distance.

    `bounds` as in `pose_from_position`.
    """
    turn, shift = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)
    box = np.asarray(bounds, dtype=np.float64)
    centre = camera_centre(turn, shift)
    distance = float(np.linalg.norm(centre - box.mean(axis=0)))
    level = Direction(0, 0, 0, (0.0, -1.0), _NEXT_HEADING, _NEXT_PITCH, _NEXT_ROLL)
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = _turn_covariance(turn, level, 0.0)
    covariance[3:, 3:] = (_STEP * distance) ** 2 / 3 * np.eye(3)
    return RoughPose(turn, shift, covariance, f"like {name}")


def pose_as_known(
    rotation: ArrayLike, translation: ArrayLike, covariance: ArrayLike | None, bounds: ArrayLike
) -> RoughPose:
    """Rough pose by one that was solved or placed by hand, which may be less sure than it says.

    Half a degree and 1 % of the distance to the scan come to its covariance; three degrees and 5 % without.
    """
    turn, shift = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)
    told = np.full((6, 6), np.nan) if covariance is None else np.asarray(covariance, dtype=np.float64)
    known = bool(np.all(np.isfinite(told)))
    degrees, share = _KNOWN if known else _BY_HAND
    away = float(np.linalg.norm(camera_centre(turn, shift) - np.asarray(bounds).mean(axis=0)))
    doubt = np.diag([math.radians(degrees) ** 2] * 3 + [(share * away) ** 2] * 3)
    return RoughPose(turn, shift, told + doubt if known else doubt, "its pose")


def _height(position: Position, world: Georeference, box: FloatArray, away: float) -> tuple[float, float]:
    """Height of the camera (m) and its variance: what the scan suggests, and the photo's own if it fits.

    The scan suggests the less, the steeper a photo `away` (m) from its middle looks.
    """
    middle = float(box[:, 2].mean())
    pitch = 0.0 if position.direction is None else position.direction.pitch
    steep = min(abs(math.tan(math.radians(pitch))), _STEEPEST)
    reach = away + 0.5 * float(np.hypot(*np.ptp(box[:, :2], axis=0)))
    variance = (0.5 * float(np.ptp(box[:, 2])) + 2.0) ** 2 + (steep * reach) ** 2
    told = position.height + world.height_shift
    told_variance = position.height_sigma**2 + world.height_sigma**2
    if not math.isfinite(told + told_variance):
        return middle, variance
    if (told - middle) ** 2 > 9 * (variance + told_variance):
        return middle, 4 * variance  # another system of heights
    total = 1 / variance + 1 / told_variance
    return (middle / variance + told / told_variance) / total, 1 / total


def _towards(centre: FloatArray, box: FloatArray, held: tuple[float, float]) -> Direction:
    """Direction from a place to the scan; its headings are in the world's plane."""
    east, north, up = (box.mean(axis=0) - centre).tolist()
    away = math.hypot(east, north)
    half = math.degrees(math.atan2(0.5 * float(np.hypot(*np.ptp(box[:, :2], axis=0))), away))
    if half > _MOST_TURN:
        raise PhotoError(
            "The photo was taken within the scan and does not tell where it looked: mark regions, or move "
            "its camera by hand."
        )
    heading, pitch = math.degrees(math.atan2(east, north)), math.degrees(math.atan2(up, away))
    return Direction(heading, pitch, held=held, heading_sigma=max(half, _LEAST_TURN))


def _rotation(heading: float, direction: Direction) -> FloatArray:
    """Rotation (3,3) world to camera of a direction whose heading (rad) is clockwise from the world's y."""
    pitch = math.radians(direction.pitch)
    east, north = math.sin(heading), math.cos(heading)
    forward = np.array([east * math.cos(pitch), north * math.cos(pitch), math.sin(pitch)])
    right = np.array([north, -east, 0.0])
    down = np.cross(forward, right)
    a, b = direction.held
    turn = math.atan2(-a, -b) + math.radians(direction.roll)
    x = math.cos(turn) * right + math.sin(turn) * down
    y = math.cos(turn) * down - math.sin(turn) * right
    return np.stack([x, y, forward])


def _turn_covariance(rotation: FloatArray, direction: Direction, turn_sigma: float) -> FloatArray:
    """Covariance (3,3), rad², of a rotation: heading about the vertical, pitch, and roll about all axes."""
    vertical = rotation[:, 2]
    level = np.cross(vertical, (0.0, 0.0, 1.0))
    size = float(np.linalg.norm(level))
    level = level / size if size > 1e-6 else np.array([1.0, 0.0, 0.0])  # looking straight down
    heading = math.radians(direction.heading_sigma) ** 2 + turn_sigma**2
    pitch, roll = math.radians(direction.pitch_sigma) ** 2, math.radians(direction.roll_sigma) ** 2
    covariance: FloatArray = (
        heading * np.outer(vertical, vertical) + pitch * np.outer(level, level) + roll * np.eye(3)
    )
    return covariance
