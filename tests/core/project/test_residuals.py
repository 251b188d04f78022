"""Edge residuals: what is drawn over a photo to judge a refinement."""

import cv2
import numpy as np
from fresco.core.cameras import PerspectiveCamera
from fresco.core.geometry.rigid import exp_so3
from fresco.core.photos.view import View
from fresco.core.project.stages.residuals import edge_residuals, pose_between
from fresco.core.scans.scan import Scan
from hypothesis import given
from hypothesis import strategies as st

CAMERA = PerspectiveCamera(480, 360, np.array([[400.0, 0, 239.5], [0, 400, 179.5], [0, 0, 1]]))


def box(low, high):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]
    return np.asarray(low) + corners * np.subtract(high, low), np.array(triangles, dtype=np.int32)


def scene(offset=(0.0, 0.0, 0.0)):
    """A box before a wall and the photo of it: the wall dark, the box bright."""
    wall = np.array([[-4, -3, 5.0], [4, -3, 5], [4, 3, 5], [-4, 3, 5]])
    body, faces = box((-0.8, -0.6, 3.5), (0.8, 0.6, 4.5))
    vertices = np.concatenate([wall, body]) + offset
    faces = np.concatenate([[[0, 1, 2], [0, 2, 3]], faces + 4]).astype(np.int32)
    scan = Scan(vertices, faces, np.zeros(3), np.arange(len(faces)), len(faces))
    image = np.full((360, 480, 3), 60, np.uint8)
    front = CAMERA.project(body[body[:, 2] < 4])
    low, high = front.min(axis=0), front.max(axis=0)
    low, high = (tuple(np.rint(end).astype(int).tolist()) for end in (low, high))
    cv2.rectangle(image, low, high, (200, 200, 200), -1)
    return scan, View(CAMERA, np.eye(3), -np.asarray(offset, dtype=float), image)


def test_a_right_pose_has_short_residuals_and_a_wrong_one_shows_its_shift():
    scan, view = scene()
    right = edge_residuals(view, scan)
    assert len(right.segments) > 200 and right.median < 0.6
    turn = exp_so3(np.array([0, 2.5 / 400, 0]))  # 2.5 px to the side
    wrong = edge_residuals(View(CAMERA, turn, turn @ view.translation, view.image), scan)
    found = wrong.offsets[np.isfinite(wrong.offsets[:, 0])]
    upright = np.abs(found[:, 0]) > np.abs(found[:, 1])
    assert 1.8 < np.median(np.abs(found[upright, 0])) < 3.2
    assert abs(np.median(found[upright, 0]) + 2.5) < 0.7, "they point to where the photo shows the edge"


def test_far_coordinates_change_nothing():
    near, far = (edge_residuals(view, scan) for scan, view in (scene(), scene((5e6, 4e5, 100))))
    assert abs(len(near.segments) - len(far.segments)) < 0.02 * len(near.segments)
    assert abs(near.median - far.median) < 0.05


def test_segments_lie_on_the_edges_they_stand_for():
    scan, view = scene()
    found = edge_residuals(view, scan)
    drawn = found.projected(CAMERA, view.rotation, view.translation)
    np.testing.assert_allclose(drawn.mean(axis=1), found.pixels, atol=0.05)
    assert np.median(np.linalg.norm(drawn[:, 1] - drawn[:, 0], axis=1)) < 2


@given(st.floats(0, 1), st.integers(0, 1000))
def test_poses_between_two_are_on_the_way(share, seed):
    rng = np.random.default_rng(seed)
    first = exp_so3(rng.normal(size=3)), rng.normal(size=3)
    second = exp_so3(0.01 * rng.normal(size=3)) @ first[0], first[1] + 0.1 * rng.normal(size=3)
    rotation, translation = pose_between(first, second, share)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    centres = [-r.T @ t for r, t in (first, second)]
    expected = (1 - share) * centres[0] + share * centres[1]
    np.testing.assert_allclose(-rotation.T @ translation, expected, atol=1e-12)
    for end, pose in ((0.0, first), (1.0, second)):
        np.testing.assert_allclose(pose_between(first, second, end)[0], pose[0], atol=1e-12)
