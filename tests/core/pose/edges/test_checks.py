"""Checks of a refined pose: each speaks up on its own grounds, and only then."""

from dataclasses import replace

import numpy as np
import pytest
from fresco.core.geometry.rigid import exp_so3
from fresco.core.pose.edges.alignment import Alignment, PosePrior
from fresco.core.pose.edges.checks import (
    CONTRADICTION,
    RIVAL,
    ambiguous,
    far_move,
    few_edges,
    halves_apart,
    no_agreement,
    open_direction,
)
from fresco.core.pose.edges.scan_edges import _pieces
from fresco.core.settings import EdgeSettings

SIGMA = np.repeat([np.radians(0.2), 0.015], 3)
SPREAD = np.array([0, 3, 18, 21, 40, 45, 63])


@pytest.fixture
def start():
    return PosePrior(exp_so3([0.3, -0.2, 0.1]), np.array([1.0, 2.0, 3.0]), np.diag(SIGMA**2))


@pytest.fixture
def alignment(start):
    # three quarters edges, one quarter start
    covariance, edge_errors = np.diag(SIGMA**2 / 4), np.diag(SIGMA**2 * 3 / 16)
    return Alignment(start.rotation, start.centre, covariance, edge_errors, 900, 1000, SPREAD)


def test_enough_spread_edges_are_believed(alignment):
    assert few_edges(alignment, EdgeSettings()) == ""


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"matched": 79, "visible": 80}, "Only 79 edges"),
        ({"matched": 0, "visible": 0}, "Only 0 edges"),
        ({"matched": 400}, "Only 40%"),
        ({"cells": np.arange(5) * 9}, "corner or strip"),
        ({"cells": np.arange(16)}, "corner or strip"),
        ({"cells": np.arange(16) * 4 // 2 * 4 % 64}, "corner or strip"),
    ],
)
def test_few_missing_or_crowded_edges_are_told(alignment, change, text):
    assert text in few_edges(replace(alignment, **change), EdgeSettings())


def test_agreement_must_be_there_and_grow():
    assert "do not follow" in no_agreement(0.9, 1.05, EdgeSettings())
    assert "no better than before (1.90 to 1.80)" in no_agreement(1.9, 1.8, EdgeSettings())
    assert no_agreement(1.2, 1.8, EdgeSettings()) == ""


def test_move_is_judged_by_the_covariance_of_the_start(start, alignment):
    near = replace(alignment, centre=start.centre + np.array([0.06, 0, 0]))
    far = replace(alignment, centre=start.centre + np.array([0.08, 0, 0]))
    assert far_move(near, start) == ""
    assert "move it by 8.0 cm" in far_move(far, start)
    turned = replace(alignment, rotation=exp_so3([0, np.radians(1.5), 0]) @ start.rotation)
    assert "turn the photo by 1.50 degrees" in far_move(turned, start)
    assert far_move(turned, replace(start, covariance=4 * start.covariance)) == ""


def test_contradicting_halves_are_told():
    assert halves_apart(0.99 * CONTRADICTION) == ""
    assert "10 times as far apart" in halves_apart(100.0)


def test_direction_that_only_an_assumption_holds_is_told(start):
    shape = np.diag([0.1, 0.1, 0.1, 0.1, 0.49, 0.1]) ** 2
    assert open_direction(shape @ start.covariance, start) == ""
    # a combination of turn and move is open, though each number alone is not at its worst
    way = np.array([0, 0.6, 0, 0.6, 0, 0]) * np.sqrt(np.diag(start.covariance))
    assert "leave open a direction" in open_direction(0.01 * start.covariance + np.outer(way, way), start)


def test_rival_is_told():
    assert ambiguous(0.99 * RIVAL) == ""
    assert "fits 93% as well" in ambiguous(0.93)


def test_widening_takes_the_edges_errors_only(alignment):
    assert np.array_equal(alignment.widened(0.3), alignment.covariance)
    # 9/16 of the edges' variance, a third of the start's, and 1/16 of the start's
    expected = SIGMA**2 * (9 / 16 * 5.0 / 3 + 1 / 16)
    assert np.allclose(np.diag(alignment.widened(5.0)), expected)


def test_outline_of_a_square_has_four_pieces():
    side = np.arange(10, 30)
    row = np.concatenate([side, side, np.full(20, 8), np.full(20, 32)])
    column = np.concatenate([np.full(20, 8), np.full(20, 32), side, side])
    normal = np.repeat([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]], 20, axis=0)
    piece = _pieces(row, column, normal, (40, 40))
    assert len(np.unique(piece)) == 4
    assert all(len(np.unique(piece[k : k + 20])) == 1 for k in range(0, 80, 20))
