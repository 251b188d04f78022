"""The parts of the photo wand: strips and their ends, expected overlap, the best path, the narrow band."""

import itertools

import numpy as np
import pytest
from fresco.core.jobs import drain
from fresco.core.regions.photo.band import across_band_job
from fresco.core.regions.photo.best_path import best_path
from fresco.core.regions.photo.choice import expected_overlaps, overlaps
from fresco.core.regions.photo.edges import evened, gradient, lab
from fresco.core.regions.photo.frames import find_frames
from fresco.core.regions.photo.lines import find_lines_job
from fresco.core.regions.photo.snap import snap_outline_job
from hypothesis import given
from hypothesis import strategies as st


def box(left, top, right, bottom):
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]], dtype=float)


def sides(corners):
    return np.concatenate([corners, np.roll(corners, -1, axis=0)], axis=1)


def overlap(first, second):
    return overlaps([first, second])[0, 1]


def test_the_far_short_ends_of_a_frieze_are_found_among_many_nearer_lines():
    frieze = np.array([[60.0, 300.0], [1140.0, 280.0], [1142.0, 350.0], [58.0, 366.0]])
    rng = np.random.default_rng(2)
    clutter = rng.uniform([250, 100], [950, 560], (220, 2))
    away = rng.uniform(-1, 1, (220, 2)) * [20, 60]
    segments = np.concatenate([sides(frieze), np.concatenate([clutter - away, clutter + away], axis=1)])
    lines = drain(find_lines_job(segments, 1200, 700))
    frames = find_frames(lines, (600, 324), 0.3, 100)
    assert max(overlap(frieze, corners) for corners in frames.corners) > 0.97


@pytest.mark.parametrize("gap", [0.0, 0.4])
def test_support_is_the_share_of_a_side_that_segments_cover(gap):
    frame = box(200, 150, 600, 400)
    segments = sides(frame)
    segments[1, 3] -= gap * 250  # the right side ends early
    found = find_frames(drain(find_lines_job(segments, 900, 600)), (400, 270), 0.3, 100)
    best = int(np.argmax([overlap(frame, corners) for corners in found.corners]))
    assert overlap(frame, found.corners[best]) > 0.98
    assert found.support[best].min() == pytest.approx(1 - gap, abs=0.02)


def test_triangles_repeat_their_first_corner():
    triangle = np.array([[300.0, 100.0], [520.0, 330.0], [80.0, 330.0]])
    found = find_frames(drain(find_lines_job(sides(triangle), 640, 480)), (300, 255), 0.3, 100)
    assert len(found.corners) > 0
    assert np.array_equal(found.corners[0, 0], found.corners[0, 3])
    assert overlap(triangle, found.corners[0]) > 0.97


def test_no_lines_no_frames():
    found = find_frames(drain(find_lines_job(np.zeros((0, 4)), 640, 480)), (300, 255), 0.3, 100)
    assert found.corners.shape == (0, 4, 2)
    assert found.support.shape == (0, 4)


@given(st.floats(0, 90), st.floats(0, 40))
def test_overlaps_of_boxes_are_those_of_their_areas(right, down):
    first, second = box(0, 0, 100, 50), box(right, down, right + 100, down + 50)
    shared = (100 - right) * (50 - down)
    assert overlap(first, second) == pytest.approx(shared / (10000 - shared), abs=0.04)
    assert overlap(first, first) == 1


def test_among_like_outlines_one_is_taken_rather_than_a_lone_one_that_scores_a_little_more():
    loops = [box(0, 0, 10, 10), *(box(100, 100, 200 + k, 200) for k in range(5)), box(0, 0, 900, 900)]
    score = np.array([1.2, 1.0, 1.0, 1.05, 1.0, 1.0, -np.inf])
    expected = expected_overlaps(loops, score, 1.0)
    assert np.argmax(expected) == 3
    assert expected[-1] == -np.inf
    assert np.argmax(expected_overlaps(loops, score, 0.01)) == 0


def test_the_best_path_is_the_best_of_all():
    rng = np.random.default_rng(1)
    strength = rng.uniform(0, 1, (6, 3))
    start = int(np.argmax(strength.max(axis=1)))

    def value(path):
        steps = np.abs(np.diff([*path, path[0]]))
        if steps.max() > 1 or path[start] != np.argmax(strength[start]):
            return -np.inf
        return strength[np.arange(6), path].sum() - 0.3 * steps.sum()

    best = max(itertools.product(range(3), repeat=6), key=value)
    assert best_path(strength, 0.3).tolist() == list(best)


@pytest.mark.parametrize("count", [200, 385, 1001])
def test_a_long_strip_has_the_same_path_as_a_short_one(count):
    middle = 8 + np.round(5 * np.sin(np.arange(count) * 6 * np.pi / count)).astype(int)
    strength = np.random.default_rng(0).uniform(0, 0.3, (count, 17))
    strength[np.arange(count), middle] += 1
    assert np.mean(best_path(strength, 0.1) == middle) > 0.98


def test_the_band_reads_what_the_whole_photo_shows():
    rng = np.random.default_rng(4)
    photo = np.full((420, 900, 3), 120, dtype=np.uint8)
    photo[200:] = 170
    photo = np.clip(photo + rng.normal(0, 2, photo.shape), 0, 255).astype(np.uint8)
    along = np.arange(20.0, 880.0, 2.0)
    normals = np.tile([0.0, 1.0], (len(along), 1))
    places = np.stack([np.repeat(along[:, None], 21, 1), np.tile(189.5 + np.arange(21), (len(along), 1))], 2)
    steps = list(across_band_job(photo, places, normals))
    assert len(steps) > 2
    across = drain(across_band_job(photo, places, normals))
    whole = gradient(evened(lab(photo))).at(places)[..., 1]
    assert np.median(np.abs(across - whole)[:, 10]) < 0.1 * np.median(whole[:, 10])
    assert np.all(np.abs(np.argmax(across, axis=1) - 10) <= 1)


def test_snapping_a_large_outline_is_cut_into_steps():
    angle = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    loop = 700 + 600 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    photo = np.random.default_rng(0).integers(0, 255, (1400, 1400, 3), dtype=np.uint8)
    assert len(list(snap_outline_job(photo, loop, 4.0))) > 8
