"""How latitude and longitude lie in the world of the scan: by its coordinate system, or by solved photos."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import FloatArray
from ..errors import PhotoError
from ..geometry.transverse_mercator import TransverseMercator, utm_zone
from .position import Position

_GEOID = 50.0  # m: heights above the sea and above the ellipsoid differ by up to twice as much
_DATUM = 2.0  # m: within that the datums of the zones are one
_CONTRADICTION = 4.0  # standard deviations by which no position is off
_LEAST_CONCENTRATION = 4.0  # 1/rad²: below, the turn is uncertain by more than half a radian


@dataclass(frozen=True, eq=False)
class Georeference:
    """A map projection, and how its plane is turned and moved into the world of the scan.

    world (x, y) = `shift` + turn(`turn`) ((east, north) - `anchor`), z = height + `height_shift`; metres,
    `turn` in rad anticlockwise. `sigma`, `height_sigma` (m) and `turn_sigma` (rad) are standard deviations.
    """

    projection: TransverseMercator
    anchor: FloatArray
    shift: FloatArray
    turn: float
    sigma: float
    turn_sigma: float
    height_shift: float
    height_sigma: float

    def place(self, position: Position) -> tuple[FloatArray, FloatArray]:
        """Place (2,) m of a photo in the world's plane and its covariance (2,2) m²."""
        away = _turned(_plane(self.projection, position) - self.anchor, self.turn)
        across = np.array([-away[1], away[0]])
        covariance = (position.sigma**2 + self.sigma**2) * np.eye(2)
        return self.shift + away, covariance + self.turn_sigma**2 * np.outer(across, across)

    def heading(self, position: Position, heading: float) -> float:
        """Angle (rad) in the world's plane, clockwise from y, of a heading from true north (degrees)."""
        return math.radians(heading) + _true_north(self.projection, position) - self.turn


def georeference_from_epsg(code: int) -> Georeference:
    """World of a scan whose coordinates are those of a UTM zone, by its EPSG code.

    Heights are taken as they are, to 50 m: scans have them above the sea, above the ellipsoid, or above a
    point of their own. Raises PhotoError for another code.
    """
    projection = utm_zone(code)
    if projection is None:
        raise PhotoError(
            f"EPSG {code} is no UTM zone that Fresco knows, such as 25832 or 32632. For a scan in another "
            "system leave the code out (-1), and solve two photos that tell their position."
        )
    origin = np.zeros(2)
    return Georeference(projection, origin, origin, 0.0, _DATUM, 0.0, 0.0, _GEOID)


def georeference(epsg: int | None, photos: Sequence[PlacedPhoto]) -> Georeference:
    """World of a scan by its EPSG code where it is known, else by solved photos; heights always by these.

    Raises PhotoError when neither tells it.
    """
    if epsg is None:
        return georeference_from_photos(photos)
    world = georeference_from_epsg(epsg)
    rise, sigma = _rise(photos)
    return replace(world, height_shift=rise, height_sigma=sigma) if math.isfinite(sigma) else world


@dataclass(frozen=True, eq=False)
class PlacedPhoto:
    """A photo whose pose and position are both known: camera centre (3,) m, viewing direction (3,), world."""

    position: Position
    centre: FloatArray
    forward: FloatArray


def georeference_from_photos(photos: Sequence[PlacedPhoto]) -> Georeference:
    """World of a scan in a system of its own, from photos that are solved and tell their position.

    Two photos that stand well apart, or one that tells its direction, give the turn about the vertical; z has
    to point up. Source: least squares of turn and shift in the plane (Umeyama 1991 without scale), compass
    directions added as von Mises observations, whose concentrations add up like vectors.

    Raises
    ------
    PhotoError
        No photos, too close together for their errors, or places that contradict each other.
    """
    if not photos:
        raise PhotoError(
            "How the photos' positions lie in the scan's coordinates is not known: give the EPSG code of the "
            "scan (step 1), or solve two photos that tell their position."
        )
    projection = _local_projection(photos)
    plane = np.array([_plane(projection, photo.position) for photo in photos])
    centres = np.array([photo.centre[:2] for photo in photos])
    weights = np.array([photo.position.sigma**-2.0 for photo in photos])
    anchor, shift = np.average(plane, axis=0, weights=weights), np.average(centres, axis=0, weights=weights)
    _check_distances(plane - anchor, centres - shift, weights)
    tells = _baselines(plane - anchor, centres - shift, weights)
    tells += sum(_compass_turn(projection, photo) for photo in photos)
    if abs(tells) < _LEAST_CONCENTRATION:
        raise PhotoError(
            "The solved photos stand too close together for the errors of their positions: solve one that "
            "was taken farther away, or give the EPSG code of the scan (step 1)."
        )
    turn_sigma = 1 / math.sqrt(abs(tells))
    rise, rise_sigma = _rise(photos)
    sigma = float(weights.sum() ** -0.5)
    turn = float(np.angle(tells))
    return Georeference(projection, anchor, shift, turn, sigma, turn_sigma, rise, rise_sigma)


def _check_distances(plane: FloatArray, centres: FloatArray, weights: FloatArray) -> None:
    """Refuse photos whose distances from their middle in the scan are not those of their positions."""
    off = np.abs(np.linalg.norm(plane, axis=1) - np.linalg.norm(centres, axis=1))
    worst = int(np.argmax(off * np.sqrt(weights)))
    if off[worst] * math.sqrt(weights[worst]) > _CONTRADICTION:
        raise PhotoError(
            f"The solved photos stand otherwise in the scan than positions tell, by {off[worst]:.1f} m: "
            "check their poses and that the scan is in metres, or give the EPSG code of the scan (step 1)."
        )


def _baselines(plane: FloatArray, centres: FloatArray, weights: FloatArray) -> complex:
    """Turn that centred places (n,2), (n,2) tell: its angle, and as length its concentration (1/rad²)."""
    a, b = plane[:, 0] + 1j * plane[:, 1], centres[:, 0] + 1j * centres[:, 1]
    return complex(np.sum(weights * np.conj(a) * b))


def _compass_turn(projection: TransverseMercator, photo: PlacedPhoto) -> complex:
    """Turn that a photo's direction tells, as `_baselines` gives it; 0 where it tells none."""
    direction = photo.position.direction
    level = float(np.hypot(*photo.forward[:2]))
    if direction is None or level < 0.3:  # looks down: a heading is not that of the viewing ray
        return 0.0
    seen = math.atan2(photo.forward[0], photo.forward[1])  # clockwise from y
    told = math.radians(direction.heading) + _true_north(projection, photo.position)
    concentration = math.radians(direction.heading_sigma) ** -2.0
    turn = told - seen
    return complex(concentration * math.cos(turn), concentration * math.sin(turn))


def _rise(photos: Sequence[PlacedPhoto]) -> tuple[float, float]:
    """Height of the world's zero against the photos' heights, m, and its standard deviation."""
    tells = [photo for photo in photos if math.isfinite(photo.position.height)]
    if not tells:
        return 0.0, math.inf
    weights = [photo.position.height_sigma**-2.0 for photo in tells]
    rises = [photo.centre[2] - photo.position.height for photo in tells]
    return float(np.average(rises, weights=weights)), sum(weights) ** -0.5


def _local_projection(photos: Sequence[PlacedPhoto]) -> TransverseMercator:
    """Plane around the photos, without scale in their middle."""
    latitude = float(np.mean([photo.position.latitude for photo in photos]))
    return TransverseMercator(photos[0].position.longitude, latitude)


def _plane(projection: TransverseMercator, position: Position) -> FloatArray:
    """East and north (2,), m."""
    return np.array(projection.plane(position.latitude, position.longitude))


def _true_north(projection: TransverseMercator, position: Position) -> float:
    return projection.true_north(position.latitude, position.longitude)


def _turned(vector: FloatArray, angle: float) -> FloatArray:
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([cosine * vector[0] - sine * vector[1], sine * vector[0] + cosine * vector[1]])
