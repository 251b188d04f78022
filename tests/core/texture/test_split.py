from __future__ import annotations

import numpy as np
import pytest
from fresco.core.cameras import FisheyeCamera, PerspectiveCamera
from fresco.core.geometry.meshes import face_normals
from fresco.core.photos import View
from fresco.core.texture import split_large_faces
from fresco.core.texture.models.split import _meet
from painted_scenes import grid_mesh, look_at


def lens(distortion=()):
    return PerspectiveCamera(600, 400, [[420, 0, 299.5], [0, 420, 199.5], [0, 0, 1]], distortion)


def view_of(camera, centre, target=(0, 0, 0)):
    rotation, translation = look_at(centre, target)
    blank = np.zeros((camera.height, camera.width, 3), np.uint8)
    return View(camera, rotation, translation, blank)


def worst_error(mesh, view, samples=400):
    """Largest distance (pixels) of affine UVs from the true projection, at random points of whole faces."""
    corners = mesh.vertices[mesh.faces]
    pixels = view.camera.project(corners.reshape(-1, 3) @ view.rotation.T + view.translation).reshape(
        -1, 3, 2
    )
    whole = view.camera.in_frame(pixels).all(axis=1)
    weights = np.random.default_rng(0).dirichlet((1, 1, 1), samples)
    points = np.einsum("sk,fkc->fsc", weights, corners[whole])
    true = view.camera.project(points.reshape(-1, 3) @ view.rotation.T + view.translation).reshape(
        -1, samples, 2
    )
    straight = np.einsum("sk,fkc->fsc", weights, pixels[whole])
    return np.linalg.norm(true - straight, axis=2).max(), whole


@pytest.mark.parametrize(
    "camera",
    [
        lens(),
        lens((-0.2, 0.05, 0.001, -0.001)),
        FisheyeCamera(600, 400, [[260, 0, 299.5], [0, 260, 199.5], [0, 0, 1]], (0.02, -0.003, 0, 0)),
    ],
    ids=["perspective", "distorted", "fisheye"],
)
def test_two_triangles_of_a_wall_become_straight_enough(camera):
    wall = grid_mesh(1, 1)
    view = view_of(camera, (1.5, 0.5, -4.0))
    mesh = split_large_faces(*wall, [view], tolerance=0.5)
    error, whole = worst_error(mesh, view)
    assert error < 0.6
    assert whole.any()


def test_small_faces_stay_as_they_are():
    wall = grid_mesh(200, 150)
    mesh = split_large_faces(*wall, [view_of(lens(), (0.5, 0.2, -5.0))])
    np.testing.assert_array_equal(mesh.faces, wall[1])
    np.testing.assert_array_equal(mesh.parent, np.arange(len(wall[1])))
    np.testing.assert_allclose(mesh.vertices, wall[0])


def test_a_wall_larger_than_the_frame_is_cut_so_that_the_photo_can_be_used():
    wall = grid_mesh(1, 1, 40.0, 30.0)
    view = view_of(lens(), (0.3, 0.2, -3.0))
    mesh = split_large_faces(*wall, [view])
    error, whole = worst_error(mesh, view)
    area = face_normals(mesh.vertices, mesh.faces)[1]
    frame = (600 / 420 * 3) * (400 / 420 * 3)
    assert area[whole].sum() > 0.9 * frame
    assert error < 0.6


def test_splitting_keeps_area_orientation_parents_and_closed_edges():
    wall = grid_mesh(3, 2)
    shift = np.array([5e6, -4e6, 100.0])
    view = view_of(lens((-0.1,)), shift + np.array([1.0, 0.5, -2.5]), shift)
    mesh = split_large_faces(wall[0] + shift, wall[1], [view], tolerance=0.25)
    assert len(mesh.faces) > len(wall[1])
    normal, area = face_normals(mesh.vertices, mesh.faces)
    before_normal, before_area = face_normals(*wall)
    np.testing.assert_allclose(np.bincount(mesh.parent, area), before_area, rtol=1e-6)
    np.testing.assert_allclose(normal, before_normal[mesh.parent], atol=1e-6)
    # Every inner edge belongs to two faces, every border edge of the wall to one: no gaps, no T-junctions.
    start, end = mesh.faces.ravel(), np.roll(mesh.faces, -1, axis=1).ravel()
    edges, count = np.unique(np.sort(np.stack([start, end], 1), axis=1), axis=0, return_counts=True)
    middle = mesh.vertices[edges].mean(axis=1) - shift
    border = (np.abs(np.abs(middle[:, 0]) - 2) < 1e-6) | (np.abs(np.abs(middle[:, 1]) - 1.5) < 1e-6)
    np.testing.assert_array_equal(count, np.where(border, 1, 2))
    halves = mesh.vertices[len(wall[0]) :]
    np.testing.assert_allclose(halves, mesh.vertices[mesh.ends].mean(axis=1), atol=1e-6)


def test_faces_nobody_sees_are_left_alone():
    wall = grid_mesh(1, 1)
    away = view_of(lens(), (0, 0, -4.0), (0, 0, -8))
    assert len(split_large_faces(*wall, [away]).faces) == 2


def test_a_frame_within_a_face_is_found_and_one_behind_a_nearer_wall_is_not():
    wall = grid_mesh(1, 1, 400.0, 300.0)
    view = view_of(lens(), (3.0, 2.0, -3.0), (3.0, 2.0, 0.0))
    assert len(split_large_faces(*wall, [view]).faces) > 2
    near = grid_mesh(1, 1, 40.0, 30.0)
    vertices = np.concatenate([wall[0], near[0] + [3.0, 2.0, -1.0]])
    mesh = split_large_faces(vertices, np.concatenate([wall[1], near[1] + len(wall[0])]), [view])
    assert (np.bincount(mesh.parent)[:2] == 1).all()
    assert (np.bincount(mesh.parent)[2:] > 1).all()


def test_a_ray_meets_the_triangle_before_the_eye_and_not_the_one_behind():
    corners = np.array([[-1.0, -1, 3], [2, -1, 3], [-1, 2, 3]])
    triangles = np.stack([corners, corners[::-1], -corners, corners + np.array([5.0, 0, 0])])
    rays = np.array([[0.0, 0, 1], [0.1, 0.1, 1]])
    np.testing.assert_array_equal(_meet(triangles, rays), [True, True, False, False])
    around = np.array([[[-50.0, -40, 0.1], [60, -40, 0.1], [0, 70, 0.1]]])  # a field of nearly 180 degrees
    assert _meet(around, np.array([[0.9, 0, 0.1]])).all()
