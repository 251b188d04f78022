"""Cameras from elsewhere land on the scan; wrong pairs and lines are found."""

import numpy as np
import pytest
from fresco.core.errors import PoseNotFound
from fresco.core.geometry.rigid import exp_so3
from fresco.core.pose import Pose
from fresco.core.pose.joint.similarity import estimate_similarity, similarity_from_poses

ROTATION, SCALE, SHIFT = exp_so3([0.4, -1.2, 0.7]), 3.7, np.array([5e6, 4e6, 120.0])


def pairs(count, seed=0):
    other = np.random.default_rng(seed).normal(size=(count, 3))
    return other, SCALE * other @ ROTATION.T + SHIFT


def test_exact_pairs_give_the_exact_similarity():
    other, scan = pairs(8)
    fit = estimate_similarity(other, scan)
    assert fit.scale == pytest.approx(SCALE, rel=1e-9)
    assert np.allclose(fit.rotation, ROTATION, atol=1e-9)
    assert np.allclose(fit.points(other), scan, atol=1e-6)


def test_wrong_pairs_are_left_out():
    other, scan = pairs(20)
    scan[:7] += np.random.default_rng(1).normal(0, 3, (7, 3))
    fit = estimate_similarity(other, scan)
    assert not fit.inliers[:7].any()
    assert fit.inliers[7:].all()
    assert fit.scale == pytest.approx(SCALE, rel=1e-6)


def test_poses_see_the_same_pixels_afterwards():
    rng = np.random.default_rng(2)
    other, poses = [], []
    for _ in range(5):
        rotation, centre = exp_so3(rng.normal(size=3)), rng.normal(size=3)
        other.append((rotation, -rotation @ centre))
        turned, moved = rotation @ ROTATION.T, SCALE * ROTATION @ centre + SHIFT
        poses.append(Pose(turned, -turned @ moved, np.eye(6)))
    poses[1] = None
    fit = similarity_from_poses(other, poses)
    rotation, translation = fit.pose(*other[1])
    point = rng.normal(size=3)
    before = other[1][0] @ point + other[1][1]
    after = rotation @ fit.points(point[None])[0] + translation
    assert np.allclose(after / SCALE, before, atol=1e-6)


def test_lines_and_too_few_pairs_are_refused():
    other, scan = pairs(6)
    with pytest.raises(PoseNotFound, match="at least three"):
        estimate_similarity(other[:2], scan[:2])
    line = np.outer(np.arange(6.0), [1, 2, 3])
    with pytest.raises(PoseNotFound, match="on one line"):
        estimate_similarity(line, SCALE * line)
    with pytest.raises(PoseNotFound, match=r"agree|line"):
        estimate_similarity(other, np.random.default_rng(3).normal(0, 50, (6, 3)))
