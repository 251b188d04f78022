"""Joint refinement of hard groups: no overlap, people, blur, like windows, half a scan, several cameras."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from fresco.core.cameras import EquirectangularCamera, FisheyeCamera, PerspectiveCamera
from fresco.core.geometry.rigid import log_so3
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
def three(wall):
    return [wall.view((x, -4.3, 0.1 * number), camera=SMALL) for number, x in enumerate((-0.9, 0.0, 0.9))]


def refined(views, scene, disturb, faces=None):
    """Poses from starts 0.15 degrees and 15 mm off that say so, and their normalised errors²."""
    covariance = np.diag(np.repeat([np.radians(0.15), 0.015], 3) ** 2 / 3)
    starts = [replace(disturb(v, 0.15, 0.015, seed), covariance=covariance) for seed, v in enumerate(views)]
    poses = refine_poses_jointly(starts, scene.vertices, scene.faces if faces is None else faces, FEW)
    steps = [
        np.r_[log_so3(v.rotation @ p.rotation.T), v.centre - p.centre]
        for p, v in zip(poses, views, strict=True)
    ]
    return poses, [s @ np.linalg.solve(p.covariance, s) for s, p in zip(steps, poses, strict=True)]


def motion_blur(length):
    kernel = np.zeros((length, length), np.float32)
    kernel[length // 2] = 1 / length
    return lambda image: cv2.filter2D(image, -1, kernel)


@pytest.mark.parametrize(
    "blurred",
    [lambda image: cv2.GaussianBlur(image, (0, 0), 3), motion_blur(25)],
    ids=["out of focus", "shaken"],
)
def test_a_blurred_photo_harms_neither_itself_nor_the_others(wall, three, disturb, blurred):
    views = [three[0], replace(three[1], image=blurred(three[1].image)), three[2]]
    poses, normalised = refined(views, wall, disturb)
    assert poses[0].refined and poses[2].refined
    assert poses[1].refined or "photos that overlap it" in poses[1].note
    assert max(centre_errors(poses, views)) < 0.02
    assert max(normalised) < 20


def test_scan_that_covers_a_third_of_the_photos(wall, three, disturb):
    middle = wall.vertices[wall.faces].mean(axis=1)
    poses, normalised = refined(three, wall, disturb, wall.faces[middle[:, 0] < -0.3])
    assert all(pose.refined for pose in poses)
    assert max(centre_errors(poses, three)) < 0.03
    assert 1 < np.mean(normalised) < 12


@pytest.mark.parametrize("period", [0.6, 0.12])
def test_a_wall_of_like_pieces_does_not_lead_to_the_next_one(wall, make_wall, disturb, period):
    """Flat, and the same again every `period` metres: within and beyond where features are looked for."""

    class LikePieces(type(wall)):
        def albedo(self, points):
            return super().albedo(np.column_stack([points[:, 0] % period, points[:, 1:]]))

    flat = make_wall(blocks=False)
    flat = LikePieces(flat.vertices, flat.faces, flat.seed)
    views = [flat.view((x, -4.3, 0.1), camera=SMALL) for x in (-0.9, 0.0, 0.9)]
    poses, normalised = refined(views, flat, disturb)
    assert max(centre_errors(poses, views)) < 0.03
    assert max(normalised) < 20


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
