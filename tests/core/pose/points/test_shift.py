"""The predicted shift on the surface is the spread that disturbed poses give."""

import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.geometry.rigid import exp_so3
from fresco.core.photos.view import View
from fresco.core.pose import Pose, predicted_face_shift, predicted_shift


def sampled_shift(pose, point, normal, count=20000):
    """Spread in mm of where the ray that showed `point` meets its tangent plane when the pose is off."""
    rng = np.random.default_rng(0)
    steps = rng.multivariate_normal(np.zeros(6), pose.covariance, count)
    ray = pose.rotation @ (point - pose.centre)
    directions = np.einsum("nji,j->ni", exp_so3(steps[:, :3]) @ pose.rotation, ray)
    centres = pose.centre + steps[:, 3:]
    along = ((point - centres) @ normal) / (directions @ normal)
    met = centres + along[:, None] * directions
    return 1000 * np.sqrt(((met - point) ** 2).sum(axis=1).mean())


@pytest.mark.parametrize("normal", [(0.0, 0, -1), (0.5, 0.2, -0.8)])
def test_shift_is_the_spread_of_disturbed_poses(normal):
    rng = np.random.default_rng(1)
    rotation = exp_so3([0.2, -0.4, 0.1])
    root = rng.normal(size=(6, 6)) * np.repeat([2e-4, 2e-3], 3)[:, None]
    pose = Pose(rotation, -rotation @ np.array([1.0, 2, 3]), root @ root.T)
    point = pose.centre + rotation.T @ np.array([0.5, -0.3, 7.0])
    normal = rotation.T @ np.array(normal) / np.linalg.norm(normal)
    predicted = predicted_shift(pose, point[None], normal[None])[0]
    assert predicted == pytest.approx(sampled_shift(pose, point, normal), rel=0.03)


def test_pure_rotation_grows_with_distance():
    pose = Pose(np.eye(3), np.zeros(3), np.diag([1e-6, 1e-6, 0, 0, 0, 0]))
    shift = predicted_shift(pose, [[0, 0, 5.0], [0, 0, 10.0]])
    assert shift == pytest.approx([1000 * 5 * np.sqrt(2e-6), 1000 * 10 * np.sqrt(2e-6)])


def test_single_step_moves_the_picture_as_predicted():
    """A covariance of rank one is a known step: its size must be what the perturbed ray shows."""
    rotation = exp_so3([0.3, 0.1, -0.2])
    centre = np.array([1.0, -2.0, 0.5])
    step = np.array([3e-6, -2e-6, 1e-6, 2e-5, 1e-5, -3e-5])
    pose = Pose(rotation, -rotation @ centre, np.outer(step, step))
    point, normal = centre + rotation.T @ np.array([0.4, 0.2, 6.0]), np.array([0.3, 0.1, -1.0])
    ray = rotation @ (point - centre)
    direction = (exp_so3(step[:3]) @ rotation).T @ ray
    origin = centre + step[3:]
    met = origin + direction * ((point - origin) @ normal) / (direction @ normal)
    predicted = predicted_shift(pose, point[None], normal[None])[0]
    assert predicted == pytest.approx(1000 * np.linalg.norm(met - point), rel=1e-4)


def test_each_face_takes_its_own_photo():
    camera = PerspectiveCamera(100, 80, np.diag([90.0, 90, 1]))
    image = np.zeros((80, 100, 3), np.uint8)
    sure, unsure = (np.eye(6) * size for size in (1e-8, 4e-8))
    views = [View(camera, np.eye(3), np.zeros(3), image, covariance=c) for c in (sure, unsure, None)]
    far = np.array([5e6, 4e6, 0.0])
    corners = np.array([[-1.0, -1, 5], [1, -1, 5], [1, 1, 5], [-1, 1, 5]])
    corners += far
    views = [View(v.camera, v.rotation, -far, v.image, covariance=v.covariance) for v in views]
    faces = np.array([[0, 1, 2], [0, 1, 2], [0, 1, 2], [0, 2, 3]])
    shift = predicted_face_shift(views, corners, faces, [0, 1, 2, -1])
    assert shift[1] == pytest.approx(2 * shift[0], rel=1e-5)
    assert np.isnan(shift[2:]).all()


def test_scan_without_photos_has_no_shift():
    assert np.isnan(predicted_face_shift([], np.eye(3), [[0, 1, 2]], [-1])).all()
