"""The predicted shift on the surface is the spread that disturbed poses give."""

import numpy as np
import pytest
from fresco.core.geometry.rigid import exp_so3
from fresco.core.pose.points.shift import predicted_shift
from fresco.core.pose.pose import Pose


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
