"""The transverse Mercator projection of the ellipsoid, as UTM and local plane coordinates use it.

Source: Krüger, Konforme Abbildung des Erdellipsoids in der Ebene, 1912; the series to the fourth power of
the third flattening as in Karney, Transverse Mercator with an accuracy of a few nanometers, 2011, equations
11, 12 and 35: a micrometre within a zone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_RADIUS, _FLATTENING = 6378137.0, 1 / 298.257223563  # WGS 84; GRS 80 is the same to 0.1 mm
_N = _FLATTENING / (2 - _FLATTENING)
_ECCENTRICITY = math.sqrt(_FLATTENING * (2 - _FLATTENING))
_RECTIFYING = _RADIUS / (1 + _N) * (1 + _N**2 / 4 + _N**4 / 64)  # m, of the sphere with as long a meridian
_SERIES = (
    _N / 2 - 2 * _N**2 / 3 + 5 * _N**3 / 16 + 41 * _N**4 / 180,
    13 * _N**2 / 48 - 3 * _N**3 / 5 + 557 * _N**4 / 1440,
    61 * _N**3 / 240 - 103 * _N**4 / 140,
    49561 * _N**4 / 161280,
)
_STEP = 1e-4  # degrees of latitude along which a meridian's direction is taken


@dataclass(frozen=True)
class TransverseMercator:
    """A projection by its central `meridian` and `parallel` (degrees), scale there, and what is added (m)."""

    meridian: float
    parallel: float = 0.0
    scale: float = 1.0
    false_east: float = 0.0
    false_north: float = 0.0

    def plane(self, latitude: float, longitude: float) -> tuple[float, float]:
        """East and north (m) of a place (degrees)."""
        east, north = _unscaled(latitude, longitude - self.meridian)
        start = _unscaled(self.parallel, 0.0)[1]
        return self.false_east + self.scale * east, self.false_north + self.scale * (north - start)

    def true_north(self, latitude: float, longitude: float) -> float:
        """Angle (rad) from the plane's north to true north, clockwise: the meridian as it is drawn."""
        low = self.plane(latitude - _STEP, longitude)
        high = self.plane(latitude + _STEP, longitude)
        return math.atan2(high[0] - low[0], high[1] - low[1])


def _unscaled(latitude: float, away: float) -> tuple[float, float]:
    """East and north (m) of a latitude, `away` from the central meridian (degrees), from the equator."""
    sine, away = math.sin(math.radians(latitude)), math.radians(math.remainder(away, 360.0))
    conformal = math.sinh(math.atanh(sine) - _ECCENTRICITY * math.atanh(_ECCENTRICITY * sine))
    up = math.atan2(conformal, math.cos(away))
    across = math.asinh(math.sin(away) / math.hypot(conformal, math.cos(away)))
    east, north = across, up
    for j, factor in enumerate(_SERIES, 1):
        north += factor * math.sin(2 * j * up) * math.cosh(2 * j * across)
        east += factor * math.cos(2 * j * up) * math.sinh(2 * j * across)
    return _RECTIFYING * east, _RECTIFYING * north


def utm_zone(code: int) -> TransverseMercator | None:
    """UTM zone by its EPSG code, of a datum that is WGS 84 to two metres; None for any other code.

    WGS 84 (326xx north, 327xx south), ETRS89 (258xx), NAD83 (269xx), GDA94 and GDA2020 (283xx, 78xx, south).
    """
    for first, zones, south in _CODES:
        zone = code - first
        if zone in zones:
            return TransverseMercator(6 * zone - 183, 0.0, 0.9996, 500_000.0, 10_000_000.0 if south else 0.0)
    return None


_CODES = (
    (32600, range(1, 61), False),
    (32700, range(1, 61), True),
    (25800, range(28, 39), False),
    (26900, range(1, 24), False),
    (28300, range(48, 59), True),
    (7800, range(46, 60), True),
)
"""Code of zone 0, zones, and whether they lie south of the equator."""
