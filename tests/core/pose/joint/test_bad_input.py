"""Joint refinement of hard groups: no overlap, people that walk, cameras of several models."""

from dataclasses import replace

import numpy as np
import pytest
from fresco.core.cameras import EquirectangularCamera, FisheyeCamera, PerspectiveCamera
from fresco.core.pose import refine_poses_jointly
from fresco.core.settings import JointSettings

SMALL = PerspectiveCamera(560, 420, [[500, 0, 279.5], [0, 500, 209.5], [0, 0, 1]])
FEW = JointSettings(features=1500)


def centre_errors(poses, views):
    return [np.linalg.norm(p.centre - v.centre) for p, v in zip(poses, views, strict=True)]


def test_photos_that_do_not_overlap_keep_their_poses(wall, disturb):
    tele = PerspectiveCamera(400, 300, [[1500, 0, 199.5], [0, 1500, 149.5], [0, 0, 1]])
    views = [wall.view((x, -4.0, 0.5), target=(x, 0, 0.5), camera=tele) for x in (-1.6, 1.6)]
    starts = [disturb(view, 0.1, 0.01, seed) for seed, view in enumerate(views)]
    for start, pose in zip(starts, refine_poses_jointly(starts, wall.vertices, wall.faces, FEW), strict=True):
        assert "photos that overlap it" in pose.note
        assert np.array_equal(pose.rotation, start.rotation)


def test_people_who_walk_through_do_not_bend_the_poses(wall, disturb):
    rng = np.random.default_rng(8)
    person = rng.integers(0, 255, (150, 70, 3)).astype(np.uint8)
    views, starts = [], []
    for number, x in enumerate((-0.9, 0.0, 0.9)):
        view = wall.view((x, -4.3, 0.1 * number), camera=SMALL)
        image = view.image.copy()
        image[200:350, 90 + 110 * number : 160 + 110 * number] = person
        views.append(view)
        starts.append(disturb(replace(view, image=image), 0.2, 0.02, number))
    poses = refine_poses_jointly(starts, wall.vertices, wall.faces, FEW)
    assert all(pose.refined for pose in poses)
    assert max(centre_errors(poses, views)) < 0.02


@pytest.fixture(scope="module")
def mixed(wall, disturb):
    fisheye = FisheyeCamera(560, 560, [[300, 0, 279.5], [0, 300, 279.5], [0, 0, 1]], [0.02, -0.01])
    cameras = [SMALL, fisheye, EquirectangularCamera(1400, 700)]
    places = [(-0.8, -3.2, 0.1), (-0.2, -2.6, 0.2), (0.3, -2.4, 0.0)]
    views = [wall.view(place, camera=camera) for place, camera in zip(places, cameras, strict=True)]
    starts = [disturb(view, 0.2, 0.015, seed) for seed, view in enumerate(views)]
    return views, refine_poses_jointly(starts, wall.vertices, wall.faces, FEW, adjust_lenses=True)


def test_cameras_of_several_models_are_adjusted_together(mixed):
    views, poses = mixed
    assert all(pose.refined for pose in poses)
    assert np.median(centre_errors(poses, views)) < 0.01


def test_panorama_says_that_it_has_no_lens_to_adjust(mixed):
    assert "panorama" in mixed[1][2].lens.note
