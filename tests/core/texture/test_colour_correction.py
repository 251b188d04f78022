from __future__ import annotations

import numpy as np
import pytest
from fresco.core.errors import PhotoError
from fresco.core.texture.colour.colour_chart import REFERENCE
from fresco.core.texture.colour.correction import fit_correction
from fresco.core.texture.colour.difference import colour_difference, lab_to_linear, linear_to_lab

CAST = np.array([[0.62, 0.10, 0.02], [0.06, 0.50, 0.05], [0.01, 0.12, 0.33]])


@pytest.mark.parametrize(
    ("one", "two", "expected"),
    [
        ((50, 2.6772, -79.7751), (50, 0, -82.7485), 2.0425),
        ((50, 3.1571, -77.2803), (50, 0, -82.7485), 2.8615),
        ((50, -1.3802, -84.2814), (50, 0, -82.7485), 1.0000),
        ((50, 2.5, 0), (50, 0, -2.5), 4.3065),
        ((50, 2.5, 0), (73, 25, -18), 27.1492),
        ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
        ((50, 0, 0), (50, -1, 2), 2.3669),
    ],
)
def test_colour_differences_are_the_published_ones(one, two, expected):
    assert colour_difference(one, two) == pytest.approx(expected, abs=1e-4)
    assert colour_difference(two, one) == pytest.approx(expected, abs=1e-4)


def test_lab_and_back():
    linear = np.random.default_rng(1).random((200, 3))
    np.testing.assert_allclose(lab_to_linear(linear_to_lab(linear)), linear, atol=1e-9)
    np.testing.assert_allclose(linear_to_lab(np.ones(3)), (100, 0, 0), atol=1e-2)


@pytest.mark.parametrize("method", ["matrix", "root-polynomial"])
def test_a_colour_cast_is_undone(method):
    true = lab_to_linear(REFERENCE)
    found = fit_correction(true @ CAST.T, REFERENCE, method=method)
    assert found.before > 10
    assert found.after < 0.1
    assert found.left_out < 0.5
    other = np.random.default_rng(2).uniform(0.05, 0.8, (50, 3))
    corrected = linear_to_lab(found.apply(other @ CAST.T))
    assert colour_difference(corrected, linear_to_lab(other)).mean() < 0.3


@pytest.mark.parametrize("method", ["matrix", "root-polynomial"])
def test_a_gain_is_taken_into_account(method):
    measured = lab_to_linear(REFERENCE) @ CAST.T
    found, gain = fit_correction(measured, REFERENCE, method=method), np.array([1.3, 0.9, 0.7])
    np.testing.assert_allclose(
        found.after_gain(gain).apply(measured * gain), found.apply(measured), atol=1e-9
    )


def test_roots_follow_a_camera_that_no_matrix_describes():
    true = lab_to_linear(REFERENCE)
    bent = np.maximum(true, 1e-3)
    bent = bent + 0.25 * np.sqrt(bent * np.roll(bent, 1, axis=1))
    matrix, roots = (fit_correction(bent, REFERENCE, method=m) for m in ("matrix", "root-polynomial"))
    assert roots.after < 0.5 * matrix.after


def test_a_dirty_patch_does_not_spoil_the_others():
    measured = lab_to_linear(REFERENCE) @ CAST.T
    measured[7] *= 2.0
    found = fit_correction(measured, REFERENCE)
    clean = np.arange(24) != 7
    rest = colour_difference(linear_to_lab(found.apply(measured[clean])), REFERENCE[clean])
    assert rest.mean() < 1.5


def test_a_burnt_out_chart_is_refused():
    usable = np.arange(24) < 10
    with pytest.raises(PhotoError, match="burnt out"):
        fit_correction(lab_to_linear(REFERENCE), REFERENCE, usable)
