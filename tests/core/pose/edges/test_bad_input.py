"""Edges on photos that are hard: what comes out is right within its sigma, or the start, and says so."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from fresco.core.cameras import CatadioptricCamera, EquirectangularCamera, PerspectiveCamera
from fresco.core.geometry.rigid import log_so3
from fresco.core.jobs import drain
from fresco.core.pose import refine_pose_by_edges
from fresco.core.pose.edges import refine_pose_on_scan_job
from fresco.core.pose.edges.rendering import EdgeScan
from scipy.stats import chi2

UNLIKELY = chi2.ppf(0.999, 6)
SMALL = PerspectiveCamera(560, 420, [[500, 0, 279.5], [0, 500, 209.5], [0, 0, 1]])


def normalised_error(pose, view):
    turn = log_so3(pose.rotation @ view.rotation.T)
    step = np.concatenate([turn, pose.centre - view.centre])
    return float(step @ np.linalg.solve(pose.covariance, step))


def assert_right_or_kept(pose, view, start):
    """A pose that was moved is where its covariance says; one that was not is the start's, with a reason."""
    if pose.refined:
        assert normalised_error(pose, view) < UNLIKELY
    else:
        assert "kept" in pose.note
        assert np.array_equal(pose.rotation, start.rotation)
        assert np.array_equal(pose.translation, start.translation)


@pytest.fixture(scope="module")
def view(wall):
    return wall.view((0.7, -4.6, 0.3), camera=SMALL, name="small")


def test_blurred_photo(wall, view, disturb):
    start = disturb(replace(view, image=cv2.GaussianBlur(view.image, (0, 0), 9)), 0.3, 0.03, 41)
    pose = refine_pose_by_edges(start, wall.vertices, wall.faces)
    assert_right_or_kept(pose, view, start)


def test_scan_that_covers_a_third_of_the_photo(wall, view, disturb):
    kept = wall.vertices[wall.faces].mean(axis=1)[:, 0] < wall.offset[0] - 0.7
    start = disturb(view, 0.2, 0.02, 42)
    pose = refine_pose_by_edges(start, wall.vertices, wall.faces[kept])
    assert_right_or_kept(pose, view, start)


def test_noisy_scan_prepared_once_serves_several_photos(wall, view, disturb):
    noise = np.random.default_rng(7).normal(0, 0.002, wall.vertices.shape)
    scan = EdgeScan.centred(wall.vertices + noise, wall.faces)
    assert scan.noisy
    for seed in (45, 46):
        start = replace(disturb(view, 0.3, 0.03, seed), covariance=np.diag(np.repeat([0.003, 0.018], 3) ** 2))
        pose = drain(refine_pose_on_scan_job(start, scan))
        assert pose.refined, pose.note
        assert np.linalg.norm(pose.centre - view.centre) < 0.03
        assert normalised_error(pose, view) < UNLIKELY


def test_people_before_the_wall(wall, view, disturb):
    crowded = view.image.copy()
    rng = np.random.default_rng(3)
    for left in (40, 200, 330, 470):
        crowded[190:400, left : left + 60] = rng.integers(20, 230, (7, 1, 3)).repeat(30, axis=0)
    start = disturb(replace(view, image=crowded), 0.3, 0.03, 43)
    pose = refine_pose_by_edges(start, wall.vertices, wall.faces)
    assert_right_or_kept(pose, view, start)


@pytest.mark.parametrize("aside", [0.07, 0.14, 0.24])
def test_row_of_like_windows_is_not_matched_one_off(make_wall, aside):
    """The start is up to a period aside: the neighbours of the windows must not pass for them."""
    flat = make_wall(blocks=False)
    x, z = flat.vertices[:, 0], flat.vertices[:, 2]
    window = (np.abs((x + 0.12) % 0.24 - 0.12) < 0.067) & (np.abs((z + 0.3) % 0.6 - 0.3) < 0.2)
    rows = replace(flat, vertices=np.stack([x, np.where(window, 0.12, 0.0), z], axis=1))
    # the frame sees windows only
    near = PerspectiveCamera(400, 300, [[640, 0, 199.5], [0, 640, 149.5], [0, 0, 1]])
    view = rows.view((0.1, -3.5, 0.1), camera=near, texture=0.3)
    start = replace(view, translation=-view.rotation @ (view.centre + np.array([aside, 0.01, 0.0])))
    assert_right_or_kept(refine_pose_by_edges(start, rows.vertices, rows.faces), view, start)


@pytest.mark.parametrize(
    "camera",
    [
        EquirectangularCamera(1400, 700),
        CatadioptricCamera(640, 640, [[420, 0, 319.5], [0, 420, 319.5], [0, 0, 1]], 0.9),
    ],
    ids=lambda camera: type(camera).__name__,
)
def test_wide_cameras_are_refined(wall, disturb, camera):
    view = wall.view((0.4, -2.2, 0.2), camera=camera)
    start = disturb(view, 0.3, 0.02, 44)
    pose = refine_pose_by_edges(start, wall.vertices, wall.faces)
    assert pose.refined, pose.note
    assert np.linalg.norm(pose.centre - view.centre) < 0.02
    assert normalised_error(pose, view) < UNLIKELY
