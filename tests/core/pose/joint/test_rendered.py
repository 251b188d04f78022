"""A telephoto shot finds its place against a picture of the coloured scan."""

import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.errors import PoseNotFound
from fresco.core.geometry.rigid import rotation_angle
from fresco.core.pose.joint.rendered import estimate_pose_from_renderings, render_colored_scan


@pytest.fixture(scope="module")
def picture(make_wall):
    wall = make_wall(blocks=False)
    wide = wall.view((0.2, -3.5, 0.1), name="wide")
    grey = np.repeat(wall.albedo(wall.vertices - wall.offset)[:, None], 3, axis=1)
    rendered = render_colored_scan(
        wide.camera, wide.rotation, wide.translation, wall.vertices, wall.faces, grey
    )
    return wall, rendered


def test_telephoto_shot_is_placed(picture):
    wall, rendered = picture
    camera = PerspectiveCamera(720, 540, [[1500, 0, 359.5], [0, 1500, 269.5], [0, 0, 1]])
    tele = wall.view((0.5, -4.5, 0.2), target=(0.3, 0, 0.1), camera=camera)
    pose = estimate_pose_from_renderings(camera, tele.image, [rendered])
    assert pose.inliers.sum() > 20
    assert np.degrees(rotation_angle(pose.rotation @ tele.rotation.T)) < 0.6
    # what counts is where the photo lands on the wall
    shown = wall.offset + np.array([[0.3, 0, 0.1], [0.0, 0, -0.2], [0.7, 0, 0.4]])
    before = camera.project(shown @ tele.rotation.T + tele.translation)
    after = camera.project(shown @ pose.rotation.T + pose.translation)
    assert np.linalg.norm(before - after, axis=1).max() < 4


def test_picture_of_something_else_is_refused(picture):
    camera = PerspectiveCamera(400, 300, [[400, 0, 200], [0, 400, 150], [0, 0, 1]])
    noise = np.random.default_rng(0).integers(0, 255, (300, 400, 3)).astype(np.uint8)
    with pytest.raises(PoseNotFound):
        estimate_pose_from_renderings(camera, noise, [picture[1]])
