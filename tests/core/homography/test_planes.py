"""Many cameras and many planes at once."""

import numpy as np
import pytest
from fresco.core.cameras import FisheyeCamera, PerspectiveCamera
from fresco.core.errors import PoseNotFound, RegionError
from fresco.core.geometry.rigid import exp_so3, rotation_angle
from fresco.core.homography import estimate_poses_and_planes
from fresco.core.homography.network import Link, Network, reaching
from fresco.core.homography.views import region_view
from fresco.core.regions import ImageRegion
from homography_scenes import POSES, plane, region, relative

CAMERA = PerspectiveCamera(1500, 1300, [[800, 0, 749.5], [0, 800, 649.5], [0, 0, 1]])
NAMES = ("ell", "prow", "step")


def regions(cameras, poses, names=NAMES, error=0.0):
    return [
        [region(camera, pose, name, error, 10 * k + i) for i, name in enumerate(names)]
        for k, (camera, pose) in enumerate(zip(cameras, poses, strict=True))
    ]


def check(found, poses, names, degrees, metres, reference=0):
    """Compare with the truth; the first plane's distance gives the scale."""
    rotations, translations, normals, distances = found
    scale = plane(poses[reference], names[0])[1] / distances[0]
    for pose, rotation, translation in zip(poses, rotations, translations, strict=True):
        turn, shift = relative(poses[reference], pose)
        assert np.degrees(rotation_angle(rotation @ turn.T)) < degrees
        assert np.linalg.norm(rotation.T @ translation * scale - turn.T @ shift) < metres
    for name, normal, distance in zip(names, normals, distances, strict=True):
        true_normal, true_distance = plane(poses[reference], name)
        assert np.degrees(np.arccos(min(normal @ true_normal, 1.0))) < 2 * degrees
        assert distance * scale == pytest.approx(true_distance, abs=metres)


def test_exact_outlines_give_millimetres():
    found = estimate_poses_and_planes([CAMERA] * 4, regions([CAMERA] * 4, POSES))
    assert found.locked
    assert found.distances[0] == 1
    check(found, POSES, NAMES, 0.05, 0.005)


def test_wrong_pieces_of_outline_do_not_count():
    found = estimate_poses_and_planes([CAMERA] * 4, regions([CAMERA] * 4, POSES, error=0.05))
    check(found, POSES, NAMES, 0.2, 0.02)
    assert 2 < np.nanmax(found.overlap_errors) < 8


def test_not_every_camera_sees_every_plane_and_any_may_be_the_reference():
    seen = regions([CAMERA] * 4, POSES)
    seen[2][0] = None  # what the reference shows
    seen[0][2] = seen[3][1] = None
    found = estimate_poses_and_planes([CAMERA] * 4, seen, reference=2)
    check(found, POSES, NAMES, 0.1, 0.01, reference=2)


def test_different_cameras():
    wide = FisheyeCamera(1400, 1400, [[600, 0, 699.5], [0, 600, 699.5], [0, 0, 1]], [0.02, -0.005, 0, 0])
    cameras = [CAMERA, wide, CAMERA]
    found = estimate_poses_and_planes(cameras, regions(cameras, POSES[:3]))
    check(found, POSES[:3], NAMES, 0.1, 0.01)


def test_a_region_that_shows_something_else_is_left_out():
    seen = regions([CAMERA] * 4, POSES)
    bars = [(100, 100), (700, 100), (700, 130), (130, 130), (130, 700), (100, 700)]
    seen[3][1] = ImageRegion.from_polygon(bars)
    found = estimate_poses_and_planes([CAMERA] * 4, seen)
    assert np.isnan(found.overlap_errors[3, 1])
    check(found, POSES, NAMES, 0.3, 0.03)


def test_a_camera_without_shared_planes_is_not_placed():
    seen = regions([CAMERA] * 3, POSES[:3])
    seen[2] = [None, None, None]
    found = estimate_poses_and_planes([CAMERA] * 3, seen)
    assert np.all(np.isnan(found.rotations[2])) and np.all(np.isfinite(found.rotations[:2]))


def test_only_what_reaches_the_reference_counts():
    view = region_view(CAMERA, region(CAMERA, POSES[0], "ell"))
    chain = [Link(0, 2, 1, (view, view)), Link(1, 0, 1, (view, view)), Link(2, 3, 4, (view, view))]
    assert reaching(chain, 0) == chain[:2]
    assert reaching(chain[2:], 0) == []


def test_unusable_input_is_refused():
    seen = regions([CAMERA] * 2, POSES[:2])
    with pytest.raises(RegionError, match="1 lists of regions for 2 cameras"):
        estimate_poses_and_planes([CAMERA] * 2, seen[:1])
    with pytest.raises(RegionError, match="one entry per plane"):
        estimate_poses_and_planes([CAMERA] * 2, [seen[0], seen[1][:2]])
    with pytest.raises(RegionError, match="no camera 2"):
        estimate_poses_and_planes([CAMERA] * 2, seen, reference=2)
    with pytest.raises(PoseNotFound, match="shares regions"):
        estimate_poses_and_planes([CAMERA] * 2, [[seen[0][0], None], [None, seen[1][1]]])


def test_derivatives_of_carried_rays():
    rng = np.random.default_rng(4)
    views = tuple(region_view(CAMERA, region(CAMERA, pose, "ell")) for pose in POSES[1:3])
    network = Network(
        exp_so3(0.2 * rng.normal(size=(3, 3))), 0.3 * rng.normal(size=(3, 3)), rng.normal(size=(2, 3)), 0
    )
    network.inverse_normals[:, 2] = 1.0
    link = Link(1, 1, 2, views)
    rays, rates = network.carried(link)
    step = 1e-6
    for place, column in zip(network.columns(link), range(15), strict=True):
        change = np.zeros(network.size)
        change[place] = step
        moved = network.stepped(change).carried(link)[0]
        assert np.allclose((moved - rays) / step, rates[:, :, column], atol=1e-4)
