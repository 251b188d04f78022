"""Edge refinement on a rendered wall: it comes back, it keeps what it cannot better, it says why."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from fresco.core.cameras import FisheyeCamera
from fresco.core.errors import PhotoError
from fresco.core.geometry.rigid import log_so3, rotation_angle
from fresco.core.pose import refine_pose_by_edges
from fresco.core.pose.edges.checks import UNLIKELY


@pytest.fixture(scope="module")
def view(wall):
    return wall.view((0.8, -5.0, 0.4), name="north")


def errors(pose, view):
    angle = np.degrees(rotation_angle(pose.rotation @ view.rotation.T))
    return angle, np.linalg.norm(pose.centre - view.centre)


def rough(view, degrees, metres):
    """The view with a covariance that owns up to so much in all."""
    sigma = np.repeat([np.radians(degrees), metres], 3) / np.sqrt(3)
    return replace(view, covariance=np.diag(sigma**2))


def normalised_error(pose, view):
    turn = log_so3(pose.rotation @ view.rotation.T)
    step = np.concatenate([turn, pose.centre - view.centre])
    return float(step @ np.linalg.solve(pose.covariance, step))


def test_pose_comes_back_from_one_degree_and_ten_centimetres(wall, view, disturb):
    start = rough(disturb(view, 1.0, 0.1, seed=1), 1.0, 0.1)
    pose = refine_pose_by_edges(start, wall.vertices, wall.faces)
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


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_good_start_gets_better_and_knows_how_sure_it_is(wall, view, disturb, seed):
    start = disturb(view, 0.3, 0.03, seed)
    pose = refine_pose_by_edges(start, wall.vertices, wall.faces)
    assert pose.refined, pose.note
    assert errors(pose, view)[0] < errors(start, view)[0]
    assert errors(pose, view)[1] < errors(start, view)[1]
    assert normalised_error(pose, view) < UNLIKELY


@pytest.mark.parametrize("seed", [21, 23])
def test_start_rougher_than_anyone_said_is_found_or_kept(wall, view, disturb, seed):
    start = disturb(view, 2.0, 0.2, seed)
    pose = refine_pose_by_edges(start, wall.vertices, wall.faces)
    if pose.refined:
        assert normalised_error(pose, view) < UNLIKELY
    else:
        assert "kept" in pose.note
        assert np.array_equal(pose.rotation, start.rotation)


def test_one_degree_and_ten_centimetres_come_back_without_a_covariance(wall, view, disturb):
    pose = refine_pose_by_edges(disturb(view, 1.0, 0.1, seed=2), wall.vertices, wall.faces)
    assert pose.refined, pose.note
    assert errors(pose, view)[0] < 0.3
    assert normalised_error(pose, view) < UNLIKELY


@pytest.mark.parametrize("kind", ["columns", "roofs"])
@pytest.mark.parametrize("seed", [33])
def test_gross_start_is_right_within_its_sigma_or_kept(make_wall, disturb, kind, seed):
    shape = shaped_wall(make_wall(blocks=False), kind)
    view = shape.view((0.3, -5.0, 0.2), name=kind)
    start = rough(disturb(view, 2.0, 0.2, seed), 2.0, 0.2)
    pose = refine_pose_by_edges(start, shape.vertices, shape.faces)
    assert pose.refined or "kept" in pose.note
    assert normalised_error(pose, view) < UNLIKELY


def shaped_wall(flat, kind):
    """Round columns, whose edges lie where one looks from, or pyramids, all creases and no steps."""
    x, z = flat.vertices[:, 0], flat.vertices[:, 2]
    height = np.zeros(len(x))
    for at in (-1.7, -0.6, 0.5, 1.6):
        if kind == "columns":
            out = np.sqrt(np.clip(0.09 - (x - at) ** 2, 0, None)) * (np.abs(z) < 1.4)
        else:
            out = 0.6 - np.maximum(np.abs(x - at), np.abs(z - 0.5 * np.sin(3 * at)) / 1.5)
        height = np.maximum(height, out)
    vertices = np.stack([x, -height, z], axis=1)
    return replace(flat, vertices=vertices)


def test_vertex_colours_hold_a_flat_wall(make_wall, disturb):
    flat = make_wall(blocks=False)
    view = flat.view((0.3, -4.0, 0.2), name="flat")
    # turn and shift look nearly alike on a flat wall: the start's own covariance has to tell them apart
    start = rough(disturb(view, 0.3, 0.02, seed=3), 0.3, 0.02)
    without = refine_pose_by_edges(start, flat.vertices, flat.faces)
    assert not without.refined
    grey = np.repeat(flat.albedo(flat.vertices - flat.offset)[:, None], 3, axis=1)
    pose = refine_pose_by_edges(start, flat.vertices, flat.faces, grey)
    assert pose.refined, pose.note
    assert errors(pose, view)[0] < 0.15


def test_fisheye_photo_is_refined_as_well(wall, disturb):
    camera = FisheyeCamera(640, 640, [[330, 0, 319.5], [0, 330, 319.5], [0, 0, 1]], [0.02, -0.01, 0, 0])
    view = wall.view((0.5, -3.0, 0.3), camera=camera, name="fisheye")
    start = rough(disturb(view, 0.8, 0.04, seed=5), 0.8, 0.04)
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
    # Rounding lets a few other edges be seen, so that the poses agree within their doubt, not to the bit.
    assert np.linalg.norm(far.centre - offset - near.centre) < 0.2 * near.centre_sigma
    assert near.centre_sigma < 0.02


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
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pose = refine_pose_by_edges(away, wall.vertices, wall.faces)
    assert "Only 0 edges" in pose.note


def test_photo_of_another_size_is_refused(wall, view):
    with pytest.raises(PhotoError, match="camera"):
        refine_pose_by_edges(replace(view, image=view.image[:-40]), wall.vertices, wall.faces)
