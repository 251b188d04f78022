"""Against coordinates by PROJ 9.6, and the properties that define the projection."""

import math

import pytest
from fresco.core.geometry.transverse_mercator import TransverseMercator, utm_zone
from hypothesis import given
from hypothesis import strategies as st


@pytest.mark.parametrize(
    ("code", "longitude", "latitude", "plane", "convergence"),
    [
        (32756, 151.21, -33.86, (334416.393990, 6251925.360352), 0.99755319),
        (32601, -179.5, 70.0, (404595.029538, 7767829.407631), -2.34940632),
        (25832, 11.5, 48.1, (686121.755803, 5330438.130054), 1.86131037),
        (32632, 6.01, 60.0, (333262.574554, 6655180.227625), -2.59000650),
    ],
)
def test_utm_coordinates_and_convergence(code, longitude, latitude, plane, convergence):
    zone = utm_zone(code)
    assert zone.plane(latitude, longitude) == pytest.approx(plane, abs=2e-4)  # two ellipsoids
    assert -math.degrees(zone.true_north(latitude, longitude)) == pytest.approx(convergence, abs=1e-6)


@given(st.floats(-80, 80), st.floats(-3, 3))
def test_the_projection_is_conformal_with_the_scale_that_it_should_have(latitude, away):
    """A step to the east and one to the north are turned and scaled alike; scale k0 (1 + east² / 2R² …)."""
    projection, step = TransverseMercator(10.0, 40.0), 1e-5
    here = projection.plane(latitude, 10 + away)
    north = projection.plane(latitude + step, 10 + away)
    east = projection.plane(latitude, 10 + away + step)
    up = complex(north[0] - here[0], north[1] - here[1])
    right = complex(east[0] - here[0], east[1] - here[1])
    e2 = 0.0066943799901413165
    sine = math.sin(math.radians(latitude))
    meridian = 6378137 * (1 - e2) / (1 - e2 * sine**2) ** 1.5 * math.radians(step)
    parallel = 6378137 / math.sqrt(1 - e2 * sine**2) * math.cos(math.radians(latitude)) * math.radians(step)
    assert up / meridian == pytest.approx(1j * right / parallel, rel=1e-5)
    assert 1 - 1e-6 < abs(up) / meridian < 1.002
    assert projection.plane(40.0, 10.0) == pytest.approx((0, 0), abs=1e-9)


def test_zones_over_the_date_line_and_codes_that_are_none():
    zone = utm_zone(32601)
    east = zone.plane(52.0, -179.9)[0] - zone.plane(52.0, 179.9)[0]
    assert east == pytest.approx(0.2 * 111_320 * math.cos(math.radians(52)), rel=0.01)
    assert utm_zone(31467) is None and utm_zone(25839) is None
    assert utm_zone(28356) == utm_zone(7856) == utm_zone(32756)
