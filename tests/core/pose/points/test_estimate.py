"""Poses from points: truth recovered, covariance calibrated, bad input refused."""

import numpy as np
import pytest
from fresco.core.cameras.perspective import PerspectiveCamera
from fresco.core.errors import PoseNotFound
from fresco.core.geometry.rigid import exp_so3, log_so3, rotation_angle
from fresco.core.pose.points.consensus import search_poses
from fresco.core.pose.points.estimate import estimate_pose_from_points
from fresco.core.pose.points.minimal import solve_p3p
from fresco.core.pose.points.perturbation import step_pose
from fresco.core.pose.points.sightings import sightings_from_pixels
from fresco.core.settings import PointSettings

CAMERA = PerspectiveCamera(3000, 2000, np.array([[2500.0, 0, 1490], [0, 2500, 1010], [0, 0, 1]]))


def scene(rng, count=30, offset=(0.0, 0.0, 0.0), noise=0.0, camera=CAMERA):
    """Random pose, points about 7 m away and their noisy pixels."""
    rotation = exp_so3(rng.normal(size=3))
    rays = camera.unproject(rng.uniform([100, 100], [2900, 1900], (count, 2)))
    in_camera = rays * rng.uniform(5, 9, (count, 1))
    centre = np.asarray(offset) + rng.normal(size=3)
    points = in_camera @ rotation + centre
    pixels = camera.project((points - centre) @ rotation.T) + rng.normal(0, noise, (count, 2))
    return rotation, centre, points, pixels


def test_p3p_contains_the_truth_in_any_direction():
    rng = np.random.default_rng(1)
    rays = rng.normal(size=(200, 3, 3))
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    rotation, centre = exp_so3(rng.normal(size=(200, 3))), rng.normal(size=(200, 3))
    points = np.einsum("bji,bkj->bki", rotation, rays * rng.uniform(1, 10, (200, 3, 1))) + centre[:, None]
    found = 0
    for k in range(200):
        rotations, _ = solve_p3p(rays[k : k + 1], points[k : k + 1])
        found += bool(len(rotations)) and rotation_angle(rotations @ rotation[k].T).min() < 1e-6
    assert found >= 198


def test_p3p_gives_nothing_for_collinear_points():
    rays = np.eye(3)[None]
    points = np.array([[[0.0, 0, 0], [1, 1, 1], [2, 2, 2]]])
    assert len(solve_p3p(rays, points)[0]) == 0


@pytest.mark.parametrize("offset", [(0, 0, 0), (5e6, 4e6, 200.0)])
def test_exact_points_give_the_exact_pose(offset):
    rotation, centre, points, pixels = scene(np.random.default_rng(2), offset=offset)
    pose = estimate_pose_from_points(CAMERA, pixels, points)
    assert np.degrees(rotation_angle(pose.rotation @ rotation.T)) < 1e-6
    assert np.linalg.norm(pose.centre - centre) < 1e-7
    assert pose.inliers.all()


def test_wrong_points_are_left_out():
    rng = np.random.default_rng(3)
    _, centre, points, pixels = scene(rng, count=40, noise=0.5)
    pixels[:16] = rng.uniform([0, 0], [3000, 2000], (16, 2))
    pose = estimate_pose_from_points(CAMERA, pixels, points)
    assert not pose.inliers[:16].any()
    assert pose.inliers[16:].sum() >= 22
    assert np.linalg.norm(pose.centre - centre) < 0.01
    assert np.abs(pose.residuals[pose.inliers]).max() < 3


def test_inactive_points_are_reported_but_not_used():
    _, _, points, pixels = scene(np.random.default_rng(4), count=12)
    pixels[0] += 300
    active = np.arange(12) > 0
    pose = estimate_pose_from_points(CAMERA, pixels, points, active)
    assert not pose.inliers[0]
    assert np.allclose(pose.residuals[0], 300, atol=5)


def test_jacobian_matches_finite_differences():
    rng = np.random.default_rng(5)
    rotation, centre, points, pixels = scene(rng, noise=3)
    sightings = sightings_from_pixels(CAMERA, pixels, points)
    _, jacobian = sightings.linearise(rotation, centre)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-6
        plus = sightings.residuals(*step_pose(rotation, centre, step))
        minus = sightings.residuals(*step_pose(rotation, centre, -step))
        assert np.allclose(jacobian[:, :, k], (plus - minus) / 2e-6, rtol=1e-5, atol=1e-3)


def test_covariance_is_calibrated():
    rng = np.random.default_rng(6)
    errors = []
    for _ in range(150):
        rotation, centre, points, pixels = scene(rng, count=15, noise=0.8)
        pose = estimate_pose_from_points(CAMERA, pixels, points)
        error = np.concatenate([log_so3(rotation @ pose.rotation.T), centre - pose.centre])
        errors.append(error @ np.linalg.solve(pose.covariance, error))
    assert 4.5 < np.mean(errors) < 7.5


@pytest.mark.parametrize(
    ("points", "sentence"),
    [
        (np.zeros((3, 3)), "needs four"),
        (np.outer(np.arange(6.0), [1, 2, 3]), "on one line"),
        (np.zeros((6, 3)), "same coordinates"),
    ],
)
def test_degenerate_points_are_refused(points, sentence):
    pixels = np.random.default_rng(7).uniform(0, 2000, (len(points), 2))
    with pytest.raises(PoseNotFound, match=sentence):
        estimate_pose_from_points(CAMERA, pixels, points)


def test_pixels_in_one_spot_are_refused():
    rng = np.random.default_rng(8)
    with pytest.raises(PoseNotFound, match="one spot"):
        estimate_pose_from_points(CAMERA, rng.normal(1000, 1, (8, 2)), rng.normal(size=(8, 3)))


def test_random_pairs_are_refused():
    rng = np.random.default_rng(9)
    pixels = rng.uniform([0, 0], [3000, 2000], (12, 2))
    with pytest.raises(PoseNotFound, match="agree on a pose"):
        estimate_pose_from_points(CAMERA, pixels, rng.normal(size=(12, 3)))


def test_two_poses_are_told_not_guessed():
    # a small flat square seen from afar nearly head-on: tilt to either side looks the same
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    rotation, centre = exp_so3([0, 0.3, 0]), np.array([0.0, 0, -60])
    rng = np.random.default_rng(10)
    pixels = CAMERA.project((square - centre) @ rotation.T) + rng.normal(0, 0.5, (4, 2))
    with pytest.raises(PoseNotFound, match=r"Two poses|hold the camera only"):
        estimate_pose_from_points(CAMERA, pixels, square)


def test_search_survives_most_points_being_wrong():
    rng = np.random.default_rng(11)
    rotation, centre, points, pixels = scene(rng, count=200, noise=0.5)
    pixels[:120] = rng.uniform([0, 0], [3000, 2000], (120, 2))
    sightings = sightings_from_pixels(CAMERA, pixels, points - points.mean(axis=0))
    found_rotation, found_centre = search_poses(sightings, PointSettings())[0]
    assert np.degrees(rotation_angle(found_rotation @ rotation.T)) < 0.5
    assert np.linalg.norm(found_centre + points.mean(axis=0) - centre) < 0.1
