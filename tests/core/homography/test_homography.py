"""One plane between two cameras: its homography, the relative pose in it, and the plane."""

import numpy as np
import pytest
from fresco.core.cameras import CatadioptricCamera, EquirectangularCamera, FisheyeCamera, PerspectiveCamera
from fresco.core.errors import PoseNotFound, RegionError
from fresco.core.geometry.rigid import exp_so3, rotation_angle
from fresco.core.homography import (
    estimate_homography,
    plane_from_homography,
    relative_pose_of_upright_plane,
    relative_poses_from_homography,
)
from fresco.core.homography.estimate import _Both, _distances, _flattening, _moment_equations, outline_step
from fresco.core.homography.views import (
    ORDER,
    moment_residuals,
    outline_distances,
    region_view,
)
from fresco.core.regions import ImageRegion
from homography_scenes import POSES, corners, plane, region, relative, true_homography
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

PERSPECTIVE = PerspectiveCamera(1800, 1500, [[1000, 0, 899.5], [0, 1000, 749.5], [0, 0, 1]])
CAMERAS = {
    "perspective": PERSPECTIVE,
    "fisheye": FisheyeCamera(1400, 1400, [[600, 0, 699.5], [0, 600, 699.5], [0, 0, 1]], [0.02, -0.005, 0, 0]),
    "mirror": CatadioptricCamera(1400, 1400, [[900, 0, 699.5], [0, 900, 699.5], [0, 0, 1]], 0.8),
    "panorama": EquirectangularCamera(4000, 2000),
}


def carried_error(camera, found, name, first, second):
    """Root-mean-square error (px) of the region's corners carried to the second photo."""
    points = corners(name)
    here = points @ first[0].T + first[1]
    there = camera.project(points @ second[0].T + second[1])
    return np.sqrt(np.mean(np.sum((camera.project(here @ found.matrix.T) - there) ** 2, axis=1)))


@pytest.mark.parametrize("kind", CAMERAS)
def test_exact_outlines_carry_to_a_fraction_of_a_pixel(kind):
    camera = CAMERAS[kind]
    images = [region(camera, pose, "ell") for pose in POSES[:2]]
    found = estimate_homography(camera, camera, *images)
    assert found.locked and not found.ambiguous
    error = carried_error(camera, found, "ell", *POSES[:2])
    assert error < 0.3
    assert error < 4 * found.transfer_error


def test_two_different_cameras():
    first, second = CAMERAS["fisheye"], PERSPECTIVE
    found = estimate_homography(
        first, second, region(first, POSES[0], "prow"), region(second, POSES[1], "prow")
    )
    truth = true_homography(*POSES[:2], "prow")
    rays = corners("prow") @ POSES[0][0].T + POSES[0][1]
    assert np.allclose(second.project(rays @ found.matrix.T), second.project(rays @ truth.T), atol=0.5)


def test_the_matrix_is_scaled_to_rotation_and_plane():
    found = estimate_homography(
        PERSPECTIVE, PERSPECTIVE, *[region(PERSPECTIVE, p, "step") for p in POSES[:2]]
    )
    assert np.allclose(found.matrix, true_homography(*POSES[:2], "step"), atol=0.01)


def test_wrong_pieces_of_outline_do_not_count():
    images = [region(PERSPECTIVE, pose, "step", 0.06, k) for k, pose in enumerate(POSES[:2])]
    found = estimate_homography(PERSPECTIVE, PERSPECTIVE, *images)
    assert found.locked
    assert found.overlap_error > 2  # of what is drawn wrongly
    assert carried_error(PERSPECTIVE, found, "step", *POSES[:2]) < 1


def test_badly_drawn_outlines_say_how_unsure_they_are():
    off, told = [], []
    for seed in range(4):
        images = [region(PERSPECTIVE, pose, "ell", 0.2, 7 * seed + k) for k, pose in enumerate(POSES[:2])]
        found = estimate_homography(PERSPECTIVE, PERSPECTIVE, *images)
        off.append(carried_error(PERSPECTIVE, found, "ell", *POSES[:2]))
        told.append(found.transfer_error)
    assert np.all(np.array(off) < 5 * np.array(told))
    assert np.median(off) < 15


def test_a_square_is_ambiguous_and_the_least_turn_is_taken():
    found = estimate_homography(
        PERSPECTIVE, PERSPECTIVE, *[region(PERSPECTIVE, p, "square") for p in POSES[:2]]
    )
    assert found.ambiguous
    assert carried_error(PERSPECTIVE, found, "square", *POSES[:2]) < 1


def test_a_triangle_is_refused():
    images = [region(PERSPECTIVE, pose, "triangle") for pose in POSES[:2]]
    with pytest.raises(PoseNotFound, match="leave open how their insides lie"):
        estimate_homography(PERSPECTIVE, PERSPECTIVE, *images)


def test_different_things_are_refused():
    corner = ImageRegion.from_polygon([(100, 100), (900, 110), (880, 180), (180, 170), (190, 800), (90, 790)])
    star = np.array([(np.cos(a), np.sin(a)) for a in np.linspace(0, 2 * np.pi, 11)[:-1]])
    star = ImageRegion.from_polygon(500 + 300 * star * np.where(np.arange(10) % 2, 0.35, 1.0)[:, None])
    with pytest.raises(PoseNotFound, match="No plane explains both outlines"):
        estimate_homography(PERSPECTIVE, PERSPECTIVE, corner, star)


def test_a_region_at_the_frame_is_refused():
    cut = ImageRegion.from_polygon([(-0.5, 100), (400, 100), (400, 500), (-0.5, 500)], name="door")
    whole = region(PERSPECTIVE, POSES[1], "ell")
    with pytest.raises(RegionError, match="'door' touches the edge of the photo"):
        estimate_homography(PERSPECTIVE, PERSPECTIVE, cut, whole)


def test_moment_and_outline_derivatives():
    images = [region(PERSPECTIVE, pose, "ell") for pose in POSES[:2]]
    first, second = (region_view(PERSPECTIVE, image) for image in images)
    both = _Both(first, second, _flattening(first.chart), _flattening(second.chart))
    matrix = true_homography(*POSES[:2], "ell") + 0.002
    matrix /= np.linalg.norm(matrix)
    ways, step = both.directions(matrix), 1e-6
    (rays, rates), _ = both.carried(matrix)
    value, slope = moment_residuals(second, rays, rates, first.following, ORDER)
    distance, tilt = outline_distances(second, rays, rates, first.following)
    for p in range(8):
        moved = first.rays @ (matrix + step * ways[p]).T
        other = moment_residuals(second, moved, rates, first.following, ORDER)[0]
        assert np.allclose((other - value) / step, slope[:, p], rtol=1e-3, atol=1e-3 * np.abs(slope).max())
        apart = (outline_distances(second, moved, rates, first.following)[0] - distance) / step
        same = np.isfinite(apart)
        assert np.mean(np.isclose(apart, tilt[:, p], rtol=1e-3, atol=1e-2 * np.nanmax(tilt))[same]) > 0.95


def test_normal_equations_belong_to_the_cost():
    images = [region(PERSPECTIVE, pose, "prow") for pose in POSES[:2]]
    first, second = (region_view(PERSPECTIVE, image) for image in images)
    both = _Both(first, second, _flattening(first.chart), _flattening(second.chart))
    matrix = true_homography(*POSES[:2], "prow") + 0.003
    matrix /= np.linalg.norm(matrix)
    ways = both.directions(matrix)
    gradient, step = _moment_equations(both, matrix, ORDER)[1], 1e-6
    for p in range(8):
        up, down = (_moment_equations(both, matrix + sign * step * ways[p], ORDER)[2] for sign in (1, -1))
        assert np.isclose(
            (up - down) / (4 * step), gradient[p], rtol=1e-3, atol=1e-3 * np.abs(gradient).max()
        )
    assert np.isfinite(_distances(both, matrix)[0]).any()


unit = arrays(np.float64, 3, elements=st.floats(-1, 1)).filter(lambda v: np.linalg.norm(v) > 0.1)


@settings(max_examples=40, deadline=None)
@given(spin=unit, shift=unit, normal=unit, scale=st.floats(0.1, 10), sign=st.sampled_from([-1, 1]))
def test_decomposition_holds_the_true_pose(spin, shift, normal, scale, sign):
    rotation, normal = exp_so3(spin), normal / np.linalg.norm(normal)
    translation = 0.5 * shift / np.linalg.norm(shift)
    if 1 + normal @ rotation.T @ translation < 0.1:
        return  # the second camera would stand behind the plane
    matrix = sign * scale * (rotation + np.outer(translation, normal))
    found = relative_poses_from_homography(matrix)
    off = [
        rotation_angle(pose.rotation @ rotation.T)
        + np.linalg.norm(np.outer(pose.translation, pose.normal) - np.outer(translation, normal))
        for pose in found
    ]
    assert min(off) < 1e-4
    for pose in found:  # all of them explain the homography
        assert np.allclose(
            pose.rotation + np.outer(pose.translation, pose.normal), sign * matrix / scale, atol=1e-6
        )


def test_rays_leave_what_both_cameras_see():
    matrix = true_homography(*POSES[:2], "ell")
    rays = corners("ell") @ POSES[0][0].T + POSES[0][1]
    found = relative_poses_from_homography(matrix, rays)
    rotation, _ = relative(*POSES[:2])
    assert 1 <= len(found) <= 2
    assert min(rotation_angle(pose.rotation @ rotation.T) for pose in found) < 1e-6


def test_a_turn_alone_leaves_the_plane_open():
    turn = exp_so3([0.1, 0.2, -0.3])
    (only,) = relative_poses_from_homography(-3 * turn)
    assert np.allclose(only.rotation, turn) and np.allclose(only.translation, 0)
    assert np.all(np.isnan(only.normal))


def test_a_singular_matrix_is_refused():
    with pytest.raises(PoseNotFound, match="singular"):
        relative_poses_from_homography(np.diag([1.0, 1.0, 0.0]))
    with pytest.raises(PoseNotFound, match="singular"):
        relative_poses_from_homography(np.full((3, 3), np.nan))


def test_a_homography_of_any_scale_is_decomposed():
    matrix = true_homography(*POSES[:2], "ell")
    for scale in (1e-6, 1e6):
        found = relative_poses_from_homography(scale * matrix)
        assert np.allclose(found[0].rotation, relative_poses_from_homography(matrix)[0].rotation)


def test_outlines_that_nothing_is_seen_of_make_no_step():
    assert np.all(outline_step(np.full(5, np.nan), np.zeros((5, 8)), 3.0) == 0)


def test_an_upright_plane_with_known_verticals_has_one_pose():
    level = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # world z up, camera y down
    tilt1, tilt2 = exp_so3([0.1, 0.02, -0.05]), exp_so3([-0.05, 0.04, 0.1])
    turn1, turn2 = tilt1 @ level @ exp_so3([0, 0, 0.2]), tilt2 @ level @ exp_so3([0, 0, -0.4])
    normal, shift = turn1 @ np.array([0.6, 0.8, 0]), np.array([0.4, 0.2, 0.3])
    rotation = turn2 @ turn1.T
    up = np.array([0, 0, 1.0])
    found = relative_pose_of_upright_plane(-2 * (rotation + np.outer(shift, normal)), turn1 @ up, turn2 @ up)
    assert rotation_angle(found.rotation @ rotation.T) < 1e-8
    assert np.allclose(np.outer(found.translation, found.normal), np.outer(shift, normal), atol=1e-8)
    assert np.linalg.norm(found.normal - normal) < 1e-8  # on the side that the camera looks to
    behind = relative_pose_of_upright_plane(
        rotation + np.outer(shift, normal), turn1 @ up, turn2 @ up, -normal[None]
    )
    assert np.linalg.norm(behind.normal + normal) < 1e-8
    with pytest.raises(PoseNotFound, match="not the homography of a vertical plane"):
        relative_pose_of_upright_plane(rotation + np.outer(shift, normal), turn1 @ up, np.array([1.0, 0, 0]))


@pytest.mark.parametrize("with_region", [False, True])
def test_the_plane_from_a_known_pose(with_region):
    images = [region(PERSPECTIVE, pose, "step") for pose in POSES[:2]]
    found = estimate_homography(PERSPECTIVE, PERSPECTIVE, *images)
    rotation, translation = relative(*POSES[:2])
    normal, distance = plane_from_homography(
        -5 * found.matrix, PERSPECTIVE, PERSPECTIVE, rotation, translation, images[0] if with_region else None
    )
    true_normal, true_distance = plane(POSES[0], "step")
    assert np.degrees(np.arccos(min(normal @ true_normal, 1.0))) < 0.5
    assert distance == pytest.approx(true_distance, rel=0.005)


def test_a_plane_behind_the_second_camera_is_refused():
    normal, back = np.array([0.0, 0, 1]), np.array([0.0, 0, -2])
    matrix = np.eye(3) + np.outer(back, normal)
    with pytest.raises(PoseNotFound, match="No plane before the cameras"):
        plane_from_homography(matrix, PERSPECTIVE, PERSPECTIVE, np.eye(3), back)


def test_no_plane_without_a_baseline():
    with pytest.raises(PoseNotFound, match="one place"):
        plane_from_homography(np.eye(3), PERSPECTIVE, PERSPECTIVE, np.eye(3), np.zeros(3))


def test_a_pose_that_contradicts_the_homography_is_refused():
    images = [region(PERSPECTIVE, pose, "step") for pose in POSES[:2]]
    rotation, translation = relative(*POSES[:2])
    with pytest.raises(PoseNotFound, match="contradict each other"):
        plane_from_homography(
            true_homography(*POSES[:2], "step"), PERSPECTIVE, PERSPECTIVE,
            exp_so3([0.0, 0.0, 0.3]) @ rotation, translation, images[0],
        )  # fmt: skip
