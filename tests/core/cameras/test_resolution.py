import numpy as np
import pytest
from fresco.core.cameras import (
    EquirectangularCamera,
    PerspectiveCamera,
    angular_resolution,
    ground_sample_distance,
    pixel_solid_angle,
)

CAMERA = PerspectiveCamera(600, 400, [[500, 0, 300], [0, 500, 200], [0, 0, 1]])


def test_wall_seen_straight():
    assert ground_sample_distance(CAMERA, [[0.3, 0.1, 7]], [[0, 0, -2]])[0] == pytest.approx(7 / 500)


def test_slanted_wall_on_the_axis():
    normal = [[np.sin(np.pi / 3), 0, -np.cos(np.pi / 3)]]
    assert ground_sample_distance(CAMERA, [[0, 0, 7]], normal)[0] == pytest.approx(7 / 500 * np.sqrt(2))


def test_edge_on_and_unseen():
    with np.errstate(all="raise"):
        assert np.isinf(ground_sample_distance(CAMERA, [[0, 0, 7]], [[0, 1, 0]])[0])
    assert np.isnan(ground_sample_distance(CAMERA, [[0, 0, -7]], [[0, 0, 1]])[0])


def test_patch_of_that_size_fills_a_pixel(any_camera):
    rng = np.random.default_rng(1)
    points = any_camera.unproject(rng.uniform([300, 100], [1300, 400], (200, 2))) * 5
    points = points[np.isfinite(points).all(axis=1)]
    normals = rng.normal(size=points.shape)
    normals[np.abs(np.sum(normals * points, axis=1)) < 1] *= np.nan
    keep = np.isfinite(normals).all(axis=1)
    points, normals = points[keep], normals[keep]
    side = ground_sample_distance(any_camera, points, normals)
    a = np.cross(normals, [0.3, 0.5, 0.8])
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b = np.cross(normals, a)
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    small = side[:, None] * 1e-3
    du = (any_camera.project(points + a * small) - any_camera.project(points - a * small)) / 2e-3
    dv = (any_camera.project(points + b * small) - any_camera.project(points - b * small)) / 2e-3
    np.testing.assert_allclose(np.abs(du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0]), 1, rtol=1e-3)


def test_panorama_covers_the_sphere():
    camera = EquirectangularCamera(200, 100)
    u, v = np.meshgrid(np.arange(200), np.arange(100))
    angles = pixel_solid_angle(camera, np.column_stack([u.ravel(), v.ravel()]))
    assert angles.sum() == pytest.approx(4 * np.pi, rel=1e-3)


def test_angle_of_a_pixel_on_the_axis():
    assert angular_resolution(CAMERA, [[300, 200]])[0] == pytest.approx(1 / 500)
    assert np.isnan(pixel_solid_angle(EquirectangularCamera(20, 10), [[3, 20]])[0])
