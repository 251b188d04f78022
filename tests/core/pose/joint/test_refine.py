"""All photos of a rendered wall together: poses return, strangers are left alone."""

from dataclasses import replace

import numpy as np
import pytest
from fresco.core.geometry.rigid import log_so3, rotation_angle
from fresco.core.pose import refine_poses_jointly


@pytest.fixture(scope="module")
def views(wall):
    places = [(-1.2, -4.2, 0.1), (-0.4, -4.4, 0.4), (0.4, -4.4, -0.2), (1.2, -4.2, 0.3)]
    return [wall.view(place, name=f"photo {k}") for k, place in enumerate(places)]


@pytest.fixture(scope="module")
def solved(wall, views, disturb):
    starts = [disturb(view, 0.2, 0.02, seed=k) for k, view in enumerate(views)]
    stranger = np.random.default_rng(9).integers(0, 255, views[0].image.shape).astype(np.uint8)
    starts.insert(2, replace(starts[0], image=stranger, name="stranger"))
    return starts, refine_poses_jointly(starts, wall.vertices, wall.faces)


def test_poses_come_back(views, solved):
    poses = [pose for k, pose in enumerate(solved[1]) if k != 2]
    angles = [
        np.degrees(rotation_angle(p.rotation @ v.rotation.T)) for p, v in zip(poses, views, strict=True)
    ]
    shifts = [np.linalg.norm(p.centre - v.centre) for p, v in zip(poses, views, strict=True)]
    assert np.median(angles) < 0.06
    assert np.median(shifts) < 0.01
    for pose in poses:
        assert pose.refined
        assert pose.shift_after < 0.5 * pose.shift_before
        assert pose.ties >= 20


def test_covariance_is_of_the_right_size(views, solved):
    poses = [pose for k, pose in enumerate(solved[1]) if k != 2]
    normalised = []
    for pose, view in zip(poses, views, strict=True):
        error = np.concatenate([log_so3(view.rotation @ pose.rotation.T), view.centre - pose.centre])
        normalised.append(error @ np.linalg.solve(pose.covariance, error))
    assert 0.05 < np.mean(normalised) < 30


def test_photo_of_something_else_keeps_its_pose_and_says_so(solved):
    start, pose = solved[0][2], solved[1][2]
    assert np.array_equal(pose.rotation, start.rotation)
    assert np.array_equal(pose.translation, start.translation)
    assert "kept" in pose.note
    assert pose.ties == 0


def test_residuals_tell_what_is_left_of_the_ties(solved):
    poses = solved[1]
    for pose in poses[:2]:
        assert len(pose.residuals) == pose.ties
        assert 0.02 < pose.residuals.length_at(0.5) < pose.residuals.length_at(0.95) < 3
        assert np.abs(pose.residuals.offsets.mean(axis=0)).max() < 0.2
        few = pose.residuals.spread(10)
        assert 20 < len(few) <= 100
        assert all((few.pixels[k] == pose.residuals.pixels).all(axis=1).any() for k in range(len(few)))
    assert len(poses[2].residuals) == 0
    assert np.isnan(poses[2].residuals.length_at(0.5))


def test_no_photos_no_poses(wall):
    assert refine_poses_jointly([], wall.vertices, wall.faces) == []
