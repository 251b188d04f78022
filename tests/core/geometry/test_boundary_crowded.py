"""Boundaries of patches with edges that belong to more than two faces, as scans have them."""

import numpy as np
from fresco.core.geometry.boundary import boundary_edges, boundary_loops


def test_boundary_closes_where_a_third_face_hangs_on_an_edge():
    # A square of two triangles; a fin stands on its left side, another on its diagonal.
    faces = np.array([[0, 1, 2], [0, 2, 3], [3, 0, 4], [0, 2, 5]])
    edges = boundary_edges(faces)
    leaving, arriving = np.bincount(edges[:, 0], minlength=6), np.bincount(edges[:, 1], minlength=6)
    np.testing.assert_array_equal(leaving, arriving)
    covered = set(np.concatenate(boundary_loops(faces)).tolist())
    assert {0, 1, 2, 3} <= covered
