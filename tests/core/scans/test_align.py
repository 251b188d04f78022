import numpy as np
import pytest
from fresco.core.errors import ScanError
from fresco.core.geometry.rigid import exp_so3, rotation_angle
from fresco.core.scans import Alignment, align_by_points, align_by_surface
from hypothesis import assume, given
from hypothesis import strategies as st

GRID = np.array([5_012_345.0, 423_456.0, 112.0])


def niche(rng, count, noise=0.0):
    """Points on a floor, two walls and a half column: surfaces of several directions."""
    kind = rng.integers(0, 4, count)
    a, b = rng.uniform(0, 3, (2, count))
    angle = rng.uniform(0, np.pi, count)
    points = np.stack(
        [
            np.select([kind == 0, kind == 1, kind == 2], [a, a, np.zeros(count)], 1.5 + 0.3 * np.cos(angle)),
            np.select([kind == 0, kind == 1, kind == 2], [b, np.zeros(count), a], 0.3 * np.sin(angle)),
            np.where(kind == 0, 0.0, b),
        ],
        axis=1,
    )
    return points + rng.normal(0, noise, points.shape) if noise else points


@given(st.integers(0, 2**32 - 1), st.integers(3, 20))
def test_exact_pairs_give_the_motion_even_in_grid_coordinates(seed, count):
    rng = np.random.default_rng(seed)
    source = rng.uniform(-5, 5, (count, 3))
    spread = np.linalg.svd(source - source.mean(axis=0))[1]
    assume(spread[1] > 0.05 * spread[0])
    rotation = exp_so3(rng.normal(0, 1.5, 3))
    target = source @ rotation.T + GRID
    found = align_by_points(source, target)
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-6)
    np.testing.assert_allclose(found.apply(source), target, atol=1e-7)
    assert found.rms < 1e-7 and np.linalg.det(found.rotation) > 0


def test_planar_points_are_enough_and_residuals_name_the_bad_pair():
    rng = np.random.default_rng(1)
    source = np.c_[rng.uniform(-5, 5, (12, 2)), np.zeros(12)]
    rotation = exp_so3([0.3, -2.0, 1.0])
    target = source @ rotation.T + 7
    target[4] += [0.08, 0, 0]
    found = align_by_points(source, target)
    assert np.argmax(found.residuals) == 4 and found.rms < 0.03
    assert rotation_angle(found.rotation @ rotation.T) < 0.02


@pytest.mark.parametrize(
    ("source", "target", "reason"),
    [
        (np.eye(3)[:2], np.eye(3)[:2], "2 point pairs cannot align"),
        (np.outer(np.arange(5.0), [1, 2, 3]), np.outer(np.arange(5.0), [1, 2, 3]), "on one line"),
        (np.eye(3), np.eye(4)[:, :3], "as many points"),
        (np.eye(3), np.full((3, 3), np.nan), "undefined coordinates"),
    ],
)
def test_pairs_that_cannot_align(source, target, reason):
    with pytest.raises(ScanError, match=reason):
        align_by_points(source, target)


@pytest.mark.parametrize("place", [np.zeros(3), GRID], ids=["near", "national grid"])
def test_surfaces_are_aligned_to_a_fraction_of_their_noise(place):
    rng = np.random.default_rng(2)
    target = niche(rng, 40_000, 0.002) + place
    source = niche(rng, 20_000, 0.002)
    strangers = rng.uniform(0, 3, (2_000, 3))  # people and plants of one day only
    rotation = exp_so3([0.02, -0.015, 0.03])
    truth = Alignment(rotation, place + np.array([0.05, -0.04, 0.06]) - rotation @ place, np.zeros(1))
    moved = (np.vstack([source, strangers]) + place - truth.translation) @ rotation
    found = align_by_surface(moved, target)
    error = found.apply(moved[:20_000]) - (source + place)
    assert np.linalg.norm(error, axis=1).max() < 0.001
    assert np.degrees(rotation_angle(found.rotation @ rotation.T)) < 0.01
    assert 0.8 < found.overlap <= 1 and np.median(found.residuals) < 0.003


def test_initial_alignment_is_used():
    rng = np.random.default_rng(3)
    target, source = niche(rng, 20_000, 0.001), niche(rng, 10_000, 0.001)
    rotation = exp_so3([0.0, 0.0, 2.0])
    moved = (source - [4, 5, 6]) @ rotation
    rough = align_by_points(moved[:4], source[:4] + rng.normal(0, 0.02, (4, 3)))
    found = align_by_surface(moved, target, rough)
    assert np.linalg.norm(found.apply(moved) - source, axis=1).max() < 0.001


def test_plain_wall_slides_and_is_refused():
    rng = np.random.default_rng(4)
    wall = np.c_[rng.uniform(0, 5, (5_000, 2)), rng.normal(0, 0.001, 5_000)]
    with pytest.raises(ScanError, match="can slide or turn along each other"):
        align_by_surface(wall, wall + 0.001)


def test_scans_that_do_not_meet_and_scans_too_small():
    rng = np.random.default_rng(5)
    with pytest.raises(ScanError, match="do not meet within 300 mm"):
        align_by_surface(niche(rng, 1000) + 50, niche(rng, 1000))
    with pytest.raises(ScanError, match="50 points are too few"):
        align_by_surface(niche(rng, 50), niche(rng, 1000))
