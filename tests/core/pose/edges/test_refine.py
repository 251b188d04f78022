"""Edge refinement on a rendered wall: it comes back, it keeps what it cannot better, it says why."""

from dataclasses import replace

import numpy as np
import pytest
from fresco.core.cameras import FisheyeCamera
from fresco.core.errors import PhotoError
from fresco.core.geometry.rigid import rotation_angle
from fresco.core.pose import refine_pose_by_edges


@pytest.fixture(scope="module")
def view(wall):
    return wall.view((0.8, -5.0, 0.4), name="north")


def errors(pose, view):
    angle = np.degrees(rotation_angle(pose.rotation @ view.rotation.T))
    return angle, np.linalg.norm(pose.centre - view.centre)


def test_pose_comes_back_from_one_degree_and_ten_centimetres(wall, view, disturb):
    pose = refine_pose_by_edges(disturb(view, 1.0, 0.1, seed=1), wall.vertices, wall.faces)
    angle, shift = errors(pose, view)
    assert pose.refined
    assert pose.score_after > pose.score_before
    assert angle < 0.3
    assert shift < 0.04


def test_pose_of_regions_gets_better(wall, view, disturb):
    pose = refine_pose_by_edges(disturb(view, 0.3, 0.03, seed=2), wall.vertices, wall.faces)
    angle, shift = errors(pose, view)
    assert angle < 0.15
    assert shift < 0.02
    assert 0.001 < pose.centre_sigma < 0.05


def test_vertex_colours_hold_a_flat_wall(make_wall, disturb):
    flat = make_wall(blocks=False)
    view = flat.view((0.3, -4.0, 0.2), name="flat")
    start = disturb(view, 0.3, 0.02, seed=3)
    without = refine_pose_by_edges(start, flat.vertices, flat.faces)
    assert not without.refined
    grey = np.repeat(flat.albedo(flat.vertices - flat.offset)[:, None], 3, axis=1)
    pose = refine_pose_by_edges(start, flat.vertices, flat.faces, grey)
    assert pose.refined, pose.note
    assert errors(pose, view)[0] < 0.15


def test_fisheye_photo_is_refined_as_well(wall, disturb):
    camera = FisheyeCamera(640, 640, [[330, 0, 319.5], [0, 330, 319.5], [0, 0, 1]], [0.02, -0.01, 0, 0])
    view = wall.view((0.5, -3.0, 0.3), camera=camera, name="fisheye")
    start = disturb(view, 0.8, 0.04, seed=4)
    pose = refine_pose_by_edges(start, wall.vertices, wall.faces)
    assert pose.refined, pose.note
    assert errors(pose, view)[0] < 0.4
    assert errors(pose, view)[0] < errors(start, view)[0]


def test_grid_coordinates_of_millions_of_metres_give_the_same_pose(wall, view, disturb):
    offset = np.array([5e6, 4e6, 300.0])
    start = disturb(view, 0.3, 0.03, seed=2)
    near = refine_pose_by_edges(start, wall.vertices, wall.faces)
    moved = replace(start, translation=-start.rotation @ (start.centre + offset))
    far = refine_pose_by_edges(moved, wall.vertices + offset, wall.faces)
    assert np.linalg.norm(far.centre - offset - near.centre) < 1e-3


def test_unrelated_photo_keeps_the_pose(wall, view):
    noise = np.random.default_rng(5).integers(0, 255, view.image.shape).astype(np.uint8)
    pose = refine_pose_by_edges(replace(view, image=noise), wall.vertices, wall.faces)
    assert not pose.refined
    assert "kept" in pose.note
    assert np.array_equal(pose.rotation, view.rotation)
    assert pose.score_before == pose.score_after


def test_camera_that_looks_away_keeps_the_pose(wall, view):
    turned = np.diag([-1.0, 1.0, -1.0]) @ view.rotation
    away = replace(view, rotation=turned, translation=-turned @ view.centre)
    pose = refine_pose_by_edges(away, wall.vertices, wall.faces)
    assert "Only 0 edges" in pose.note


def test_photo_of_another_size_is_refused(wall, view):
    with pytest.raises(PhotoError, match="camera"):
        refine_pose_by_edges(replace(view, image=view.image[:-40]), wall.vertices, wall.faces)
