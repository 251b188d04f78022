"""What every camera model must do."""

import pickle

import cv2
import numpy as np
import pytest
from fresco.core.cameras import (
    CatadioptricCamera,
    DivisionCamera,
    EquirectangularCamera,
    ExtendedUnifiedCamera,
    FieldOfViewCamera,
    FisheyeCamera,
    InverseRadialCamera,
    PerspectiveCamera,
    PolynomialCamera,
)
from fresco.core.errors import CameraError

K = np.array([[500.0, 0, 803.3], [0, 495.0, 590.8], [0, 0, 1]])


def frame_grid(camera, n=40):
    u, v = np.meshgrid(np.linspace(-0.5, camera.width - 0.5, n), np.linspace(-0.5, camera.height - 0.5, n))
    return np.column_stack([u.ravel(), v.ravel()])


def seen_pixels(camera, n=40):
    """Pixels of the frame inside the field, not at its very rim."""
    pixels = frame_grid(camera, n)
    return pixels[np.isfinite(camera.unproject(pixels)).all(axis=1)]


def test_round_trip_from_pixels(any_camera):
    pixels = seen_pixels(any_camera)
    assert len(pixels) > 500
    rays = any_camera.unproject(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, atol=1e-14)
    inner = np.abs(rays[:, 1]) < 1 - 1e-12  # a panorama's poles have no column
    back = any_camera.unwrapped(any_camera.project(rays * 23), pixels)
    np.testing.assert_allclose(back[inner], pixels[inner], atol=1e-7)


def test_round_trip_from_directions(any_camera):
    points = np.random.default_rng(3).normal(size=(4000, 3)) * np.random.default_rng(4).uniform(
        1, 50, (4000, 1)
    )
    pixels = any_camera.project(points)
    seen = np.isfinite(pixels).all(axis=1)
    assert seen.sum() > 200 and np.array_equal(seen, np.isfinite(pixels).any(axis=1))
    back = any_camera.unproject(pixels[seen])
    rays = points[seen] / np.linalg.norm(points[seen], axis=1, keepdims=True)
    near = np.abs(pixels[seen] - 800).max(axis=1) < 4000
    np.testing.assert_allclose(back[near], rays[near], atol=1e-9)


def test_jacobian_is_exact(any_camera):
    # Central differences of two step sizes, extrapolated.
    points = any_camera.unproject(seen_pixels(any_camera, 12)) * 3
    pixels, jacobian = any_camera.project_with_jacobian(points)
    np.testing.assert_allclose(pixels, any_camera.project(points), atol=1e-10)
    regular = np.isfinite(jacobian).all(axis=(1, 2)) & (np.abs(jacobian).max(axis=(1, 2)) < 1e4)
    assert regular.sum() > 40
    for axis in range(3):
        numeric = [_difference(any_camera, points[regular], axis, h) for h in (2e-4, 1e-4)]
        extrapolated = (4 * numeric[1] - numeric[0]) / 3
        np.testing.assert_allclose(jacobian[regular][..., axis], extrapolated, rtol=1e-6, atol=2e-5)


def _difference(camera, points, axis, h):
    d = np.eye(3)[axis] * h
    ahead, behind = camera.project(points + d), camera.project(points - d)
    return (camera.unwrapped(ahead, behind) - behind) / (2 * h)


def test_jacobian_on_the_axis(any_camera):
    points = np.array([[0.0, 0, 2], [1e-9, -1e-9, 2], [1e-200, 0, 2]])
    jacobian = any_camera.project_with_jacobian(points)[1]
    assert np.isfinite(jacobian).all()
    np.testing.assert_allclose(jacobian[1:], jacobian[:1].repeat(2, 0), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(jacobian[0, :, :2], _difference_on_axis(any_camera), rtol=1e-6, atol=1e-5)


def _difference_on_axis(camera):
    return np.stack([_difference(camera, np.array([[0.0, 0, 2]]), axis, 1e-4)[0] for axis in (0, 1)], axis=-1)


def test_depth_does_not_matter(any_camera):
    points = np.random.default_rng(5).normal(size=(500, 3))
    expected = any_camera.project(points)
    for scale in (1e-6, 1e7):
        np.testing.assert_allclose(any_camera.project(points * scale), expected, rtol=1e-9, atol=1e-7)


def test_missing_input_stays_missing(any_camera):
    bad = np.array([[np.nan] * 3, [0.0, 0, 0]])
    pixels, jacobian = any_camera.project_with_jacobian(bad)
    assert np.isnan(pixels).all() and np.isnan(jacobian).all() and np.isnan(any_camera.project(bad)).all()
    assert np.isnan(any_camera.unproject([[np.nan, np.nan]])).all()
    assert any_camera.project(np.empty((0, 3))).shape == (0, 2)
    assert any_camera.unproject(np.empty((0, 2))).shape == (0, 3)


def test_never_garbage_far_outside(any_camera):
    pixels = np.random.default_rng(6).uniform(-1e4, 1e4, (4000, 2))
    rays = any_camera.unproject(pixels)
    seen = np.isfinite(rays).all(axis=1)
    assert np.array_equal(seen, np.isfinite(rays).any(axis=1))
    back = any_camera.unwrapped(any_camera.project(rays[seen]), pixels[seen])
    # At the very rim a direction no longer tells the pixel; it must not tell another one.
    known = np.isfinite(back).all(axis=1)
    assert known.mean() > 0.99
    np.testing.assert_allclose(back[known], pixels[seen][known], atol=1e-4)


@pytest.mark.parametrize("factor", [0.5, 0.25, 2.0, 0.3])
def test_scaled_keeps_the_corners(any_camera, factor):
    points = any_camera.unproject(seen_pixels(any_camera, 9)) * 5
    points = points[np.abs(points[:, 0]) > 1e-9]
    expected = (any_camera.project(points) + 0.5) * factor - 0.5
    small = any_camera.scaled(factor)
    assert type(small) is type(any_camera)
    assert (small.width, small.height) == (
        round(any_camera.width * factor),
        round(any_camera.height * factor),
    )
    np.testing.assert_allclose(small.project(points), expected, atol=1e-7)


def test_resized_fills_the_new_frame(any_camera):
    points = any_camera.unproject(seen_pixels(any_camera, 9)) * 5
    points = points[np.abs(points[:, 0]) > 1e-9]
    small = any_camera.resized(333, 240)
    ratio = np.array([333 / any_camera.width, 240 / any_camera.height])
    expected = (any_camera.project(points) + 0.5) * ratio - 0.5
    np.testing.assert_allclose(small.project(points), expected, atol=1e-7)


@pytest.mark.parametrize("factor", [0.0, -1.0, np.nan])
def test_scale_must_be_positive(any_camera, factor):
    with pytest.raises(CameraError, match="positive"):
        any_camera.scaled(factor)


def test_survives_pickling(any_camera):
    points = np.random.default_rng(7).normal(size=(50, 3))
    copy = pickle.loads(pickle.dumps(any_camera))
    np.testing.assert_allclose(copy.project(points), any_camera.project(points), rtol=1e-12)


def test_fisheye_agrees_with_opencv():
    lens = (-0.02, 0.003, -0.002, 0.0004)
    camera = FisheyeCamera(1600, 1200, K, lens)
    points = np.random.default_rng(8).uniform([-3, -3, 0.5], [3, 3, 4], (500, 3))
    expected = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), K, np.array(lens))[0][
        :, 0
    ]
    np.testing.assert_allclose(camera.project(points), expected, atol=1e-9)


def test_fisheye_sees_behind_itself_until_its_fold():
    camera = FisheyeCamera(1600, 1200, K)
    angles = np.radians([100.0, 179.9])
    points = np.column_stack([np.sin(angles), 0 * angles, np.cos(angles)])
    np.testing.assert_allclose(camera.project(points)[:, 0], 803.3 + 500 * angles, atol=1e-9)
    assert np.isnan(camera.project([[0, 0, -1.0]])).all()
    folding = FisheyeCamera(1600, 1200, K, (-0.1,))
    assert folding.field_angle == pytest.approx(np.sqrt(1 / 0.3))  # d/dt (t - 0.1 t^3) = 0
    angles = folding.field_angle + np.array([-1e-6, 1e-6])
    pixels = folding.project(np.column_stack([np.sin(angles), 0 * angles, np.cos(angles)]))
    assert np.isfinite(pixels[0]).all() and np.isnan(pixels[1]).all()


def test_unified_sphere_by_its_definition():
    points = np.random.default_rng(9).normal(size=(500, 3))
    sphere = points / np.linalg.norm(points, axis=1, keepdims=True)
    for xi in (0.3, 0.85, 1.0, 1.4):
        edge = -min(xi, 1 / xi)
        pixels = CatadioptricCamera(1600, 1200, K, xi).project(points)
        seen = sphere[:, 2] > edge
        plane = sphere[:, :2] / (sphere[:, 2:] + xi)
        np.testing.assert_allclose(
            pixels[seen], (plane * [500, 495] + [803.3, 590.8])[seen], atol=1e-6, rtol=1e-9
        )
        assert np.isnan(pixels[~seen]).all()


def test_unified_sphere_without_mirror_is_perspective():
    points = np.random.default_rng(10).normal(size=(500, 3))
    np.testing.assert_allclose(
        CatadioptricCamera(1600, 1200, K, 0).project(points),
        PerspectiveCamera(1600, 1200, K).project(points),
        rtol=1e-12,
    )


def test_mei_distortion_is_opencvs_on_the_plane():
    lens = np.array((-0.05, 0.01, 4e-4, -3e-4))
    points = np.random.default_rng(11).uniform([-1, -1, 0.2], [1, 1, 1], (200, 3))
    plane = points / (points[:, 2:] + 1.2 * np.linalg.norm(points, axis=1, keepdims=True))
    plane[:, 2] = 1
    expected = cv2.projectPoints(plane, np.zeros(3), np.zeros(3), K, lens)[0][:, 0]
    np.testing.assert_allclose(
        CatadioptricCamera(1600, 1200, K, 1.2, lens).project(points), expected, atol=1e-9
    )


def test_polynomial_by_its_definition():
    coefficients, stretch = (485.0, 0, -7.2e-4, 2.1e-7, -4.4e-10), (1.01, 0.003, -0.002)
    camera = PolynomialCamera(1600, 1200, (803.3, 590.8), coefficients, stretch)
    plane = np.random.default_rng(12).uniform(-500, 500, (300, 2))
    rho = np.hypot(*plane.T)
    points = np.column_stack([plane, np.polynomial.polynomial.polyval(rho, coefficients)])
    expected = plane @ np.array([[1.01, 0.003], [-0.002, 1]]).T + (803.3, 590.8)
    np.testing.assert_allclose(camera.project(points * 0.01), expected, atol=1e-9)
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    np.testing.assert_allclose(camera.unproject(expected), rays, atol=1e-13)


def test_polynomial_ends_where_its_angle_folds():
    camera = PolynomialCamera(1600, 1200, (800, 600), (400.0, 0, 1e-3))  # grows inward: g - rho g' = 0
    assert camera.limit == pytest.approx(np.sqrt(400 / 1e-3))
    rays = camera.unproject([[800 + camera.limit - 1e-3, 600], [800 + camera.limit + 1e-3, 600]])
    assert np.isfinite(rays[0]).all() and np.isnan(rays[1]).all()
    beyond = camera.field_angle + 1e-6
    assert np.isnan(camera.project([[np.sin(beyond), 0, np.cos(beyond)]])).all()


def test_polynomial_of_one_number_is_perspective():
    points = np.random.default_rng(13).uniform([-1, -1, 0.5], [1, 1, 2], (200, 3))
    pinhole = PerspectiveCamera(1600, 1200, [[700, 0, 803.3], [0, 700, 590.8], [0, 0, 1]])
    camera = PolynomialCamera(1600, 1200, (803.3, 590.8), [700.0])
    np.testing.assert_allclose(camera.project(points), pinhole.project(points), atol=1e-9)


def test_panorama_looks_where_it_should():
    camera = EquirectangularCamera(1600, 800)
    points = np.array(
        [[0, 0, 1.0], [1, 0, 0], [-1, 0, 0], [0, 1, 1], [0, -1, 0], [1e-9, 0, -1], [-1e-9, 0, -1]]
    )
    expected = [[799.5, 399.5], [1199.5, 399.5], [399.5, 399.5], [799.5, 599.5], [799.5, -0.5]]
    expected += [[1599.5, 399.5], [-0.5, 399.5]]
    np.testing.assert_allclose(camera.project(points), expected, atol=1e-6)


def test_panorama_seam_can_be_crossed():
    camera = EquirectangularCamera(1600, 800)
    np.testing.assert_allclose(camera.unproject([[1605.0, 300]]), camera.unproject([[5.0, 300]]), atol=1e-14)
    triangle = np.array([[1598.0, 10], [3.0, 12], [1590.0, 13]])
    np.testing.assert_allclose(camera.unwrapped(triangle, triangle[0])[:, 0], [1598, 1603, 1590])
    assert np.isnan(camera.unproject([[10.0, -0.51], [10.0, 799.51]])).all()


def test_cropped_panorama_is_a_window_of_the_whole():
    whole, crop = (
        EquirectangularCamera(2400, 1200),
        EquirectangularCamera(1600, 500, (2400, 1200), (1300, 200)),
    )
    pixels = frame_grid(crop)
    np.testing.assert_allclose(
        crop.unproject(pixels), whole.unproject(pixels + np.array([1300, 200])), atol=1e-14
    )
    with pytest.raises(CameraError, match="larger"):
        EquirectangularCamera(2500, 500, (2400, 1200))


def test_lens_models_by_their_definitions():
    points = np.random.default_rng(14).uniform([-1, -1, 0.3], [1, 1, 2], (300, 3))
    r2 = (points[:, :2] ** 2).sum(axis=1)
    r, z = np.sqrt(r2), points[:, 2]
    gains = {
        ExtendedUnifiedCamera(1600, 1200, K, 0.6, 1.1): 1 / (0.6 * np.sqrt(1.1 * r2 + z * z) + 0.4 * z),
        DivisionCamera(1600, 1200, K, -0.2): 2 / (z + np.sqrt(z * z + 0.8 * r2)),
        FieldOfViewCamera(1600, 1200, K, 0.8): np.arctan(2 * np.tan(0.4) * r / z) / 0.8 / r,
    }
    for camera, gain in gains.items():
        expected = points[:, :2] * gain[:, None] * [500, 495] + [803.3, 590.8]
        np.testing.assert_allclose(camera.project(points), expected, atol=1e-9)


def test_inverse_radial_lens_by_its_definition():
    camera = InverseRadialCamera(1600, 1200, K, 0.1)
    seen = np.random.default_rng(15).uniform(-1.5, 1.5, (200, 2))
    points = np.column_stack([seen * (1 + 0.1 * (seen**2).sum(axis=1, keepdims=True)), np.ones(200)])
    np.testing.assert_allclose(camera.project(points * 3), seen * [500, 495] + [803.3, 590.8], atol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FisheyeCamera(10, 10, K, [0.1] * 7), "up to 6"),
        (lambda: FisheyeCamera(10, 10, K, [np.inf]), "finite"),
        (lambda: CatadioptricCamera(10, 10, K, -0.1), "xi"),
        (lambda: PolynomialCamera(10, 10, (5, 5), [-100.0]), "a0"),
        (lambda: PolynomialCamera(10, 10, (5, 5), []), "coefficients"),
        (lambda: PolynomialCamera(10, 10, (5, 5, 5), [100.0]), "centre"),
        (lambda: PolynomialCamera(10, 10, (5, 5), [100.0], (0, 1, 1)), "stretch"),
        (lambda: EquirectangularCamera(10, 10, (0, 5)), "positive"),
        (lambda: EquirectangularCamera(10, 10, (10, 10), (np.nan, 0)), "two numbers"),
        (lambda: ExtendedUnifiedCamera(10, 10, K, 1.2, 1), "alpha"),
        (lambda: DivisionCamera(10, 10, K, np.nan), "finite"),
        (lambda: FieldOfViewCamera(10, 10, K, 4.0), "omega"),
        (lambda: InverseRadialCamera(10, 10, K, np.inf), "finite"),
        (lambda: FisheyeCamera(0, 10, K), "whole number"),
    ],
)
def test_bad_parameters_are_explained(make, message):
    with pytest.raises(CameraError, match=message):
        make()
