import numpy as np
import pytest
from fresco.core.geometry.boundary import boundary_loops, subdivided, without_collinear, wound_alike


def grid(count):
    x, y = np.meshgrid(np.arange(count + 1.0), np.arange(count + 1.0))
    first = np.arange(count * (count + 1)).reshape(count, count + 1)[:, :-1].ravel()
    faces = np.concatenate(
        [
            np.stack([first, first + 1, first + count + 2], axis=1),
            np.stack([first, first + count + 2, first + count + 1], axis=1),
        ]
    )
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1), faces


def test_boundary_of_a_grid_and_its_corners():
    vertices, faces = grid(6)
    (loop,) = boundary_loops(faces)
    assert len(loop) == 24
    corners = without_collinear(vertices[loop], 1e-9)
    assert sorted(map(tuple, corners[:, :2])) == [(0, 0), (0, 6), (6, 0), (6, 6)]


def test_hole_gives_a_second_loop_that_runs_against_the_first():
    vertices, faces = grid(6)
    middle = vertices[faces].mean(axis=1)
    faces = faces[np.abs(middle[:, :2] - 3).max(axis=1) > 1]
    loops = [vertices[loop] for loop in boundary_loops(faces)]
    areas = sorted(np.cross(loop, np.roll(loop, -1, axis=0))[:, 2].sum() / 2 for loop in loops)
    np.testing.assert_allclose(areas, [-4.0, 36.0])


@pytest.mark.parametrize("damage", ["flipped", "doubled", "degenerate"])
def test_damaged_faces_leave_the_boundary_alone(damage):
    _, faces = grid(5)
    expected = {frozenset(loop.tolist()) for loop in boundary_loops(faces)}
    if damage == "flipped":
        faces[::3] = faces[::3, ::-1]
    elif damage == "doubled":
        faces = np.concatenate([faces, faces[3:9, [1, 2, 0]]])
    else:
        faces = np.concatenate([faces, [(3, 3, 4)]])
    assert {frozenset(loop.tolist()) for loop in boundary_loops(faces)} == expected


def test_wound_alike_follows_the_majority():
    _, faces = grid(4)
    damaged = faces.copy()
    damaged[[1, 7, 20]] = damaged[[1, 7, 20], ::-1]
    edges = np.concatenate([wound_alike(damaged)[:, [i, (i + 1) % 3]] for i in range(3)])
    assert len(np.unique(edges, axis=0)) == len(edges)


def test_closed_surface_has_no_loops():
    tetrahedron = [(0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)]
    assert boundary_loops(tetrahedron) == []


def test_thinned_circle_stays_within_tolerance():
    angle = np.linspace(0, 2 * np.pi, 3000, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    thin = without_collinear(circle, 1e-4)
    assert len(thin) < 400
    middle = 0.5 * (thin + np.roll(thin, -1, axis=0))
    assert np.linalg.norm(middle, axis=1).min() > 1 - 3e-4


def test_subdivided_edges_are_short_and_on_the_polygon():
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    cut = subdivided(square, 0.3)
    assert np.linalg.norm(np.roll(cut, -1, axis=0) - cut, axis=1).max() <= 0.3
    assert len(cut) == 16
    np.testing.assert_allclose(np.abs(cut - 0.5).max(axis=1), 0.5)
