import cv2
import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.errors import CameraError

K = np.array([[2900.0, 0.7, 1990.3], [0, 2875.0, 1312.8], [0, 0, 1]])
LENSES = {
    "none": (),
    "barrel": (-0.28, 0.09, 4e-4, -3e-4),
    "pincushion": (0.12, 0.05, -1e-3, 8e-4, 0.01),
    "rational": (8.2, 3.1, 2e-4, -1e-4, 0.2, 8.6, 5.2, 0.9),
    "prism": (-0.1, 0.03, 4e-4, -3e-4, 0.01, 0.02, 0.001, 0, 1e-3, -2e-4, -8e-4, 1e-4),
    "one": (-0.2,),
}


@pytest.fixture(params=LENSES)
def camera(request):
    return PerspectiveCamera(4000, 2650, K, LENSES[request.param])


def frame_grid(camera, n=60):
    u, v = np.meshgrid(np.linspace(-0.5, camera.width - 0.5, n), np.linspace(-0.5, camera.height - 0.5, n))
    return np.column_stack([u.ravel(), v.ravel()])


def test_agrees_with_opencv(camera):
    rng = np.random.default_rng(1)
    points = rng.uniform([-0.6, -0.4, 1], [0.6, 0.4, 1.1], (500, 3)) * rng.uniform(0.5, 90, (500, 1))
    no_skew = K.copy()
    no_skew[0, 1] = 0
    lens = camera.distortion.opencv
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), no_skew, np.array(lens))[0][:, 0]
    plain = PerspectiveCamera(camera.width, camera.height, no_skew, lens)
    np.testing.assert_allclose(plain.project(points), expected, atol=1e-8)


def test_round_trip_over_the_frame(camera):
    pixels = frame_grid(camera)
    rays = camera.unproject(pixels)
    assert np.isfinite(rays).all()
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, atol=1e-14)
    np.testing.assert_allclose(camera.project(rays * 37), pixels, atol=1e-9)


def test_jacobian_against_differences(camera):
    points = camera.unproject(frame_grid(camera, 9)) * 7
    pixels, jacobian = camera.project_with_jacobian(points)
    np.testing.assert_allclose(pixels, camera.project(points), atol=1e-10)
    step = 1e-5
    for axis in range(3):
        d = np.eye(3)[axis] * step
        numeric = (camera.project(points + d) - camera.project(points - d)) / (2 * step)
        np.testing.assert_allclose(jacobian[..., axis], numeric, rtol=1e-6, atol=1e-4)


def test_nothing_behind_the_camera(camera):
    points = np.array([[0.1, 0.2, -3], [0, 0, 0], [1, 0, 0], [np.nan] * 3])
    pixels, jacobian = camera.project_with_jacobian(points)
    assert np.isnan(pixels).all() and np.isnan(jacobian).all()
    assert np.isnan(camera.project(points)).all()


def test_outside_the_frame_stays_finite():
    camera = PerspectiveCamera(400, 300, [[300, 0, 200], [0, 300, 150], [0, 0, 1]])
    pixel = camera.project([[5.0, 0, 1]])
    np.testing.assert_allclose(pixel, [[1700, 150]])
    assert not camera.in_frame(pixel)[0]


def test_field_of_barrel_distortion_ends_where_it_folds():
    camera = PerspectiveCamera(400, 300, [[100, 0, 200], [0, 100, 150], [0, 0, 1]], [-0.25])
    fold = np.sqrt(1 / 0.75)  # d/dr (r - 0.25 r^3) = 0
    assert camera.distortion.limit == pytest.approx(fold, rel=1e-12)
    inside, outside = camera.project([[fold - 1e-6, 0, 1], [fold + 1e-6, 0, 1]])
    assert np.isfinite(inside).all() and np.isnan(outside).all()
    rim = 200 + 100 * (fold - 0.25 * fold**3)
    rays = camera.unproject([[rim - 1e-6, 150], [rim + 1e-6, 150]])
    assert np.isfinite(rays[0]).all() and np.isnan(rays[1]).all()
    np.testing.assert_allclose(camera.project(rays[:1]), [[rim - 1e-6, 150]], atol=1e-9)


def test_field_of_rational_distortion_ends_at_its_pole():
    camera = PerspectiveCamera(400, 300, [[100, 0, 200], [0, 100, 150], [0, 0, 1]], [0, 0, 0, 0, 0, -1])
    assert camera.distortion.limit == pytest.approx(1)  # r / (1 - r^2)
    assert np.isnan(camera.project([[1.1, 0, 1]])).all()
    pixels = np.array([[1e5, 150], [-2e5, 4e4]])
    np.testing.assert_allclose(camera.project(camera.unproject(pixels)), pixels, rtol=1e-10)


def test_unproject_is_never_garbage_far_outside(camera):
    pixels = np.random.default_rng(2).uniform(-2e4, 2e4, (3000, 2))
    rays = camera.unproject(pixels)
    seen = np.isfinite(rays).all(axis=1)
    np.testing.assert_allclose(camera.project(rays[seen]), pixels[seen], atol=1e-7)
    assert np.isnan(rays[~seen]).all()


@pytest.mark.parametrize("factor", [0.5, 0.25, 2.0, 0.3])
def test_scaled_keeps_the_corners(camera, factor):
    points = camera.unproject(frame_grid(camera, 9))
    expected = (camera.project(points) + 0.5) * factor - 0.5
    small = camera.scaled(factor)
    assert (small.width, small.height) == (round(4000 * factor), round(2650 * factor))
    np.testing.assert_allclose(small.project(points), expected, atol=1e-9)


def test_resized_fills_the_new_frame(camera):
    small = camera.resized(333, 221)
    np.testing.assert_allclose(
        small.project(camera.unproject([[-0.5, -0.5], [3999.5, 2649.5]])),
        [[-0.5, -0.5], [332.5, 220.5]],
        atol=1e-9,
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((400, 300, np.eye(2)), "3 x 3"),
        ((400, 300, np.diag([1.0, 1, 2])), "form"),
        ((400, 300, np.diag([-1.0, 1, 1])), "positive"),
        ((400.5, 300, np.eye(3)), "whole number"),
        ((400, 300, np.eye(3), [np.nan]), "finite"),
        ((400, 300, np.eye(3), [0.0] * 12 + [0.1, 0]), "tilted"),
        ((400, 300, np.eye(3), [0.0] * 15), "At most 12"),
    ],
)
def test_bad_parameters_are_explained(arguments, message):
    with pytest.raises(CameraError, match=message):
        PerspectiveCamera(*arguments)
