"""Properties that hold for any lens, however odd its calibration."""

import numpy as np
import pytest
from fresco.core.cameras import (
    CatadioptricCamera,
    Distortion,
    EquirectangularCamera,
    ExtendedUnifiedCamera,
    FisheyeCamera,
    PolynomialCamera,
)
from hypothesis import given, settings
from hypothesis import strategies as st

K = np.array([[500.0, 0.4, 803.3], [0, 495.0, 590.8], [0, 0, 1]])
DISK = np.column_stack([np.linspace(0.02, 0.99, 60), np.arange(60) * 2.4])  # radius and angle


def coefficients(count, size):
    return st.lists(st.floats(-size, size, allow_subnormal=False), min_size=count, max_size=count)


def check_round_trip(camera, angles):
    """Check directions at the given angles off the axis, all around it."""
    around = np.arange(angles.size) * 2.4
    rays = np.column_stack([np.sin(angles) * np.cos(around), np.sin(angles) * np.sin(around), np.cos(angles)])
    pixels, jacobian = camera.project_with_jacobian(rays)
    assert np.isfinite(pixels).all() and np.isfinite(jacobian).all()
    np.testing.assert_allclose(camera.unproject(pixels), rays, atol=1e-7)
    # The derivative along the ray is nothing, whatever the lens.
    along = np.einsum("nij,nj->ni", jacobian, rays)
    assert np.abs(along).max() <= 1e-9 * np.abs(jacobian).max()


@settings(max_examples=60, deadline=None)
@given(coefficients(3, 1.5), coefficients(3, 1.5), coefficients(2, 0.05), coefficients(4, 0.03))
def test_any_distortion_is_undone_inside_its_field(radial, denominator, tangential, prism):
    lens = Distortion(tuple(radial), tuple(denominator), tuple(tangential), tuple(prism))
    radius = DISK[:, 0] * min(lens.limit, 5.0)
    x, y = radius * np.cos(DISK[:, 1]), radius * np.sin(DISK[:, 1])
    xd, yd = lens.apply(x, y)
    assert np.isfinite(xd).all() and np.isfinite(yd).all()
    back = lens.undo(xd, yd)
    np.testing.assert_allclose(back, [x, y], atol=1e-6)


@settings(max_examples=60, deadline=None)
@given(coefficients(3, 1.5), coefficients(3, 1.5), coefficients(2, 0.05), coefficients(2, 30.0))
def test_undistorting_is_right_or_says_nothing(radial, denominator, tangential, point):
    lens = Distortion(tuple(radial), tuple(denominator), tuple(tangential))
    xd, yd = np.array([point[0]]), np.array([point[1]])
    x, y = lens.undo(xd, yd)
    assert np.isfinite(x) == np.isfinite(y)
    if np.isfinite(x):
        assert np.hypot(x, y) < lens.limit
        np.testing.assert_allclose(lens.apply(x, y), [xd, yd], rtol=1e-9, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(coefficients(3, 1.0), coefficients(3, 1.0), coefficients(2, 0.05))
def test_distortion_has_its_derivative(radial, denominator, tangential):
    lens = Distortion(tuple(radial), tuple(denominator), tuple(tangential))
    radius = DISK[:, 0] * 0.8 * min(lens.limit, 2.0)
    x, y, h = radius * np.cos(DISK[:, 1]), radius * np.sin(DISK[:, 1]), 1e-6
    numeric = [
        np.array(lens.apply(x + dx, y + dy)) - np.array(lens.apply(x - dx, y - dy))
        for dx, dy in ((h, 0), (0, h))
    ]
    exact = np.array(lens.jacobian(x, y)).reshape(2, 2, -1)
    scale = np.abs(exact).max()
    np.testing.assert_allclose(exact[:, 0], numeric[0] / (2 * h), atol=1e-5 * scale)
    np.testing.assert_allclose(exact[:, 1], numeric[1] / (2 * h), atol=1e-5 * scale)


@settings(max_examples=40, deadline=None)
@given(coefficients(4, 0.1))
def test_any_fisheye(lens):
    camera = FisheyeCamera(1600, 1200, K, lens)
    check_round_trip(camera, np.linspace(0, 0.99, 40) * camera.field_angle)


@settings(max_examples=40, deadline=None)
@given(st.floats(50, 3000), coefficients(4, 1.0), st.floats(0.9, 1.1), coefficients(2, 0.05))
def test_any_polynomial(a0, shape, c, de):
    terms = [a0, 0.0, *(value / a0 ** (i + 1) for i, value in enumerate(shape))]
    camera = PolynomialCamera(1600, 1200, (803.3, 590.8), terms, (c, *de))
    check_round_trip(camera, np.linspace(0, 0.99, 40) * min(camera.field_angle, 3.1))


@settings(max_examples=40, deadline=None)
@given(st.floats(0, 3))
def test_any_unified_sphere(xi):
    edge = np.arccos(-min(xi, 1 / xi) if xi > 0 else 0.0)
    check_round_trip(CatadioptricCamera(1600, 1200, K, xi), np.linspace(0, 0.98, 40) * edge)


@settings(max_examples=40, deadline=None)
@given(st.floats(0, 1), st.floats(0.2, 3))
def test_any_extended_sphere(alpha, beta):
    smaller, larger = sorted((alpha, 1 - alpha))
    # Z > -(smaller / larger) sqrt(beta r^2 + Z^2) turned into an angle.
    w = smaller / larger
    edge = np.pi / 2 + np.arctan(w * np.sqrt(beta) / np.sqrt(max(1 - w * w, 1e-12)))
    check_round_trip(ExtendedUnifiedCamera(1600, 1200, K, alpha, beta), np.linspace(0, 0.98, 40) * edge)


@settings(max_examples=40, deadline=None)
@given(st.floats(-1e4, 1e4), st.floats(-0.5, 799.5))
def test_any_pixel_of_a_panorama(u, v):
    camera = EquirectangularCamera(1600, 800)
    ray = camera.unproject([[u, v]])
    assert np.linalg.norm(ray) == pytest.approx(1)
    if np.hypot(ray[0, 0], ray[0, 2]) > 1e-9:
        np.testing.assert_allclose(camera.unwrapped(camera.project(ray), [[u, v]]), [[u, v]], atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(first=st.floats(0.1, 3), second=st.floats(0.1, 3))
def test_scaling_twice_is_scaling_once(any_camera_for_properties, first, second):
    for camera in any_camera_for_properties:
        points = np.array([[0.1, 0.2, 1.0], [-0.3, 0.1, 0.9]])
        twice, once = camera.scaled(first).scaled(second), camera.scaled(first * second)
        np.testing.assert_allclose(twice.project(points), once.project(points), rtol=1e-9, atol=1e-7)
