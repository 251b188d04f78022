import numpy as np
from fresco.core.geometry.contours import resampled, smoothed
from fresco.core.geometry.outlines import fill_loops, loop_area, mask_loops, pieces_of
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

MASKS = arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12)))


@given(MASKS)
def test_outline_filled_again_is_the_mask(mask):
    loops = mask_loops(mask)
    if not mask.any():
        assert loops == []
        return
    assert loop_area(loops) == np.count_nonzero(mask)
    np.testing.assert_array_equal(fill_loops(loops, mask.shape[1], mask.shape[0]), mask)


@given(MASKS)
def test_outline_steps_are_one_pixel(mask):
    for loop in mask_loops(mask):
        np.testing.assert_array_equal(np.abs(np.roll(loop, -1, axis=0) - loop).sum(axis=1), 1.0)


def test_hole_has_negative_area():
    mask = np.ones((5, 6), dtype=bool)
    mask[2, 2:4] = False
    assert sorted(loop_area([loop]) for loop in mask_loops(mask)) == [-2.0, 30.0]


def test_fill_samples_pixel_centres():
    """A pixel belongs to a shape if its centre does."""
    filled = fill_loops([np.array([(0.4, 0.6), (3.6, 0.6), (3.6, 2.4), (0.4, 2.4)])], 6, 4)
    expected = np.zeros((4, 6), dtype=bool)
    expected[1:3, 1:4] = True
    np.testing.assert_array_equal(filled, expected)


def test_smoothed_circle_keeps_its_size():
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    circle = 50 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    curve = smoothed(resampled(circle, 1.0), 7)
    np.testing.assert_allclose(np.linalg.norm(curve.points, axis=1), 50.0, atol=2e-3)
    np.testing.assert_allclose(np.sum(curve.points * curve.tangents, axis=1), 0.0, atol=1e-4)


def test_smoothed_pixel_outline_lies_on_the_line():
    rows, columns = np.mgrid[0:200, 0:200]
    mask = (rows > 40.3 + 0.37 * columns) & (columns > 20) & (columns < 180) & (rows < 190)
    curve = smoothed(mask_loops(mask)[0], 7)
    u, v = curve.points.T
    on_line = (np.abs(v - 40.3 - 0.37 * u) < 2) & (u > 40) & (u < 160)
    off = (v - 40.3 - 0.37 * u)[on_line] / np.hypot(1, 0.37)
    assert abs(off.mean()) < 0.02
    assert off.std() < 0.15


def test_pieces_have_the_holes_that_lie_in_them():
    mask = np.zeros((30, 60), dtype=bool)
    mask[2:28, 2:28], mask[6:24, 6:24], mask[10:20, 10:20] = True, False, True  # a part within a hole
    mask[13:17, 13:17] = False
    mask[2:12, 40:50] = True
    pieces = pieces_of(mask_loops(mask))
    sizes = [[abs(loop_area([loop])) for loop in piece] for piece in pieces]
    assert sorted(sizes) == [[100], [100, 16], [26 * 26, 18 * 18]]
