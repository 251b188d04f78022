"""Sets of faces on a grid of triangles: grown, shrunk, filled, smoothed, freed of specks."""

import numpy as np
import pytest
from fresco.core.geometry.meshes import edge_pairs, face_normals
from fresco.core.regions.surface.face_sets import (
    faces_without_holes,
    faces_without_specks,
    grown_faces,
    shrunk_faces,
    smoothed_faces,
)

SIDE = 12  # squares of 1 m, two triangles each


@pytest.fixture(scope="module")
def grid():
    """Return neighbouring faces (E,2), areas (F,), and each face's square (F,2)."""
    v, u = (a.ravel() for a in np.mgrid[0 : SIDE + 1, 0 : SIDE + 1])
    y, x = (a.ravel() for a in np.mgrid[0:SIDE, 0:SIDE])
    corner = y * (SIDE + 1) + x
    lower = np.stack([corner, corner + 1, corner + SIDE + 2], axis=1)
    upper = np.stack([corner, corner + SIDE + 2, corner + SIDE + 1], axis=1)
    faces = np.concatenate([lower, upper])
    points = np.stack([u, v, np.zeros(len(u))], axis=1).astype(float)
    square = np.tile(np.stack([x, y], axis=1), (2, 1))
    return edge_pairs(faces, len(points)).face, face_normals(points, faces)[1], square


def block(square, low, high):
    """Faces of the squares from `low` to `high`, both (x, y) and inclusive."""
    return np.all((square >= low) & (square <= high), axis=1)


def test_growing_adds_the_faces_across_every_edge(grid):
    pair, area, square = grid
    inside = block(square, (4, 4), (7, 7))
    grown = grown_faces(inside, pair)
    assert grown[inside].all()
    assert area[grown].sum() == pytest.approx(16 + 4 * 4 / 2)  # half a square per side's square
    np.testing.assert_array_equal(shrunk_faces(grown, pair), inside)


def test_shrinking_keeps_the_border_of_the_scan(grid):
    pair, _, square = grid
    everything = np.ones(len(square), dtype=bool)
    assert shrunk_faces(everything, pair, 3).all()
    left = block(square, (0, 0), (5, SIDE - 1))
    less = shrunk_faces(left, pair)
    assert less[block(square, (0, 0), (4, SIDE - 1))].all()
    assert less.sum() == left.sum() - SIDE


def test_holes_are_filled_but_not_the_surroundings(grid):
    pair, area, square = grid
    whole = block(square, (2, 2), (9, 9))
    ring = whole & ~block(square, (5, 5), (6, 6))
    np.testing.assert_array_equal(faces_without_holes(ring, pair, area), whole)
    open_ring = ring & ~block(square, (7, 5), (9, 5))
    np.testing.assert_array_equal(faces_without_holes(open_ring, pair, area), open_ring)
    band = block(square, (2, 0), (3, SIDE - 1))
    np.testing.assert_array_equal(faces_without_holes(band, pair, area), band)


def test_only_the_largest_piece_stays(grid):
    pair, area, square = grid
    large, small = block(square, (0, 0), (4, 4)), block(square, (8, 8), (9, 9))
    np.testing.assert_array_equal(faces_without_specks(large | small, pair, area), large)
    nothing = np.zeros(len(square), dtype=bool)
    assert not faces_without_specks(nothing, pair, area).any()


def test_smoothing_takes_teeth_off_and_leaves_straight_sides(grid):
    pair, _, square = grid
    straight = block(square, (0, 0), (5, SIDE - 1))
    np.testing.assert_array_equal(smoothed_faces(straight, pair), straight)
    tooth = straight.copy()
    tooth[np.flatnonzero(block(square, (9, 5), (9, 5)))[0]] = True
    np.testing.assert_array_equal(smoothed_faces(tooth, pair), straight)


def test_loose_triangles_have_no_neighbours():
    pair = np.zeros((0, 2), dtype=np.int32)
    inside = np.array([True, False, True])
    area = np.array([1.0, 1.0, 2.0])
    np.testing.assert_array_equal(grown_faces(inside, pair), inside)
    np.testing.assert_array_equal(faces_without_holes(inside, pair, area), inside)
    np.testing.assert_array_equal(faces_without_specks(inside, pair, area), [False, False, True])
    np.testing.assert_array_equal(smoothed_faces(inside, pair), inside)
