"""How much each tie counts: once for all that lie on the same patch of the scan."""

import numpy as np
import pytest
from fresco.core.pose.joint.solution import patch_shares


def wall(rng, depth, noise=0.005, count=4000):
    """Ties (T,3) scattered about a wall of 6 x 6 m at a depth."""
    place = rng.uniform(0, 6, (count, 2))
    return np.column_stack([place, depth + rng.normal(0, noise, count)])


@pytest.mark.parametrize("depth", [0.0, 0.005, -0.0075, 0.1])
def test_ties_before_and_behind_a_wall_count_alike(depth):
    points = wall(np.random.default_rng(0), depth)
    share = patch_shares(points, np.ones(len(points), dtype=bool), 1.5)
    off = points[:, 2] - depth
    assert abs((share * off).sum() / share.sum() - off.mean()) < 2e-4
    assert share[off > 0].mean() == pytest.approx(share[off < 0].mean(), rel=0.05)


def test_all_ties_together_count_once_for_each_patch():
    points = wall(np.random.default_rng(1), 0.0)
    share = patch_shares(points, np.ones(len(points), dtype=bool), 1.5)
    inside = ((points[:, :2] > 1) & (points[:, :2] < 5)).all(axis=1)
    assert share[inside].sum() == pytest.approx(16 / 1.5**2, rel=0.15)


def test_points_without_a_tie_count_nothing():
    points = wall(np.random.default_rng(2), 0.0, count=200)
    tied = np.arange(200) % 2 == 0
    share = patch_shares(points, tied, 1.5)
    assert (share[~tied] == 0).all()
    assert np.array_equal(share[tied], patch_shares(points[tied], np.ones(100, dtype=bool), 1.5))
    assert (patch_shares(points, np.zeros(200, dtype=bool), 1.5) == 0).all()
