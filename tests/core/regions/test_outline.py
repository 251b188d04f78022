import numpy as np
import pytest
from fresco.core.errors import RegionError
from fresco.core.regions.photo.outline import (
    brush_mask,
    checked_selection,
    combined,
    grown_mask,
    mask_polygons,
    polygon_mask,
    smoothed_mask,
    without_holes,
    without_specks,
)
from hypothesis import given, settings
from hypothesis import strategies as st


def square(size=40, low=10, high=30):
    mask = np.zeros((size, size), dtype=bool)
    mask[low:high, low:high] = True
    return mask


def test_holes_are_filled_but_a_bay_stays_open():
    mask = square()
    mask[15:20, 15:20] = False
    mask[10:14, 25:27] = False  # open to the outside
    filled = without_holes(mask)
    assert filled[15:20, 15:20].all()
    assert not filled[10:14, 25:27].any()


def test_specks_go_and_the_largest_piece_stays():
    mask = square()
    mask[2:4, 2:4] = True
    mask[34:38, 34:38] = True
    assert np.array_equal(without_specks(mask), square())
    assert np.count_nonzero(without_specks(mask, smallest=10)) == 400 + 16


def test_smoothing_removes_a_spike_and_keeps_straight_edges():
    mask = square(80, 20, 60)
    mask[19, 40] = True
    smooth = smoothed_mask(mask, 2.0)
    assert not smooth[19, 40]
    assert np.array_equal(smooth[30:50], mask[30:50])


def test_growing_and_shrinking_move_the_outline_by_the_distance():
    mask = np.zeros((60, 80), dtype=bool)
    mask[20:40, 30:50] = True
    grown = grown_mask(mask, 5)
    assert np.flatnonzero(grown[30]).tolist() == list(range(25, 55))
    assert not grown[15, 25]  # corners are rounded
    assert np.flatnonzero(grown_mask(mask, -5)[30]).tolist() == list(range(35, 45))
    assert not grown_mask(mask, -20).any()


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_polygons_of_a_mask_draw_the_same_mask(seed):
    mask = np.random.default_rng(seed).random((12, 15)) < 0.6
    mask[0, 0] = True
    loops = mask_polygons(mask, tolerance=0.0)
    assert np.array_equal(polygon_mask(loops, 15, 12), mask)


def test_brush_covers_the_pixels_within_its_radius():
    dot = brush_mask([[20.0, 15.0]], 4.0, 50, 40)
    v, u = np.nonzero(dot)
    assert np.hypot(u - 20, v - 15).max() <= 4.6
    assert abs(np.count_nonzero(dot) - np.pi * 16) < 12
    stroke = brush_mask([[5.0, 20.0], [45.0, 20.0]], 3.0, 50, 40)
    assert stroke[20, 5:46].all() and not stroke[26].any()


def test_brush_and_lasso_may_leave_the_frame():
    assert brush_mask([[-10.0, 5.0], [1e9, 5.0]], 2.0, 20, 20)[5].all()
    mask = polygon_mask([[[-5, -5], [10, -5], [10, 10], [-5, 10]]], 20, 20)
    assert np.count_nonzero(mask) in (100, 110, 121)


def test_strokes_combine():
    a, b = square(40, 5, 20), square(40, 15, 30)
    assert np.array_equal(combined(a, b, "add"), a | b)
    assert np.array_equal(combined(a, b, "subtract"), a & ~b)
    assert np.array_equal(combined(a, b, "replace"), b)
    assert not combined(None, b, "subtract").any()


def test_errors_say_what_to_do():
    with pytest.raises(RegionError, match="three corners"):
        polygon_mask([[[0, 0], [5, 5]]], 10, 10)
    with pytest.raises(RegionError, match="not numbers"):
        polygon_mask([[[0, 0], [5, np.nan], [3, 3]]], 10, 10)
    with pytest.raises(RegionError, match="radius"):
        brush_mask([[1, 1]], 0, 10, 10)
    tiny = np.zeros((10, 10), dtype=bool)
    tiny[5, 5:8] = True
    with pytest.raises(RegionError, match="only 3 pixels"):
        checked_selection(tiny)
