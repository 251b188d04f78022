from dataclasses import replace

import numpy as np
import pytest
from fresco.core import jobs
from fresco.core.cameras import (
    CatadioptricCamera,
    EquirectangularCamera,
    FisheyeCamera,
    PerspectiveCamera,
    PolynomialCamera,
)
from fresco.core.errors import PoseNotFound, RegionError
from fresco.core.geometry.rigid import exp_so3, log_so3, rotation_angle
from fresco.core.pose import Pose, estimate_pose, estimate_pose_and_focal, estimate_pose_job
from fresco.core.regions import ImageRegion, SurfaceRegion
from hypothesis import given, settings
from hypothesis import strategies as st
from region_scenes import ELL, LOCAL, SHIFT, Scene

MATRIX = [[800, 0, 599.5], [0, 800, 399.5], [0, 0, 1]]
CAMERA = PerspectiveCamera(1200, 800, MATRIX)
THREE = ["ell", "prow", "gable"]


def assert_close(pose, scene, degrees=0.05, metres=0.004):
    assert np.degrees(rotation_angle(pose.rotation @ scene.rotation.T)) < degrees
    assert np.linalg.norm(pose.centre - scene.centre) < metres


@pytest.mark.parametrize(
    "camera",
    [
        CAMERA,
        PerspectiveCamera(1200, 800, MATRIX, [-0.2, 0.05, 0.001, -0.002]),
        FisheyeCamera(1200, 800, [[500, 0, 599.5], [0, 500, 399.5], [0, 0, 1]], [0.02, -0.01]),
        PolynomialCamera(1200, 800, [599.5, 399.5], [500.0, 0.0, -6e-4]),
        CatadioptricCamera(1200, 800, [[1000, 0, 599.5], [0, 1000, 399.5], [0, 0, 1]], 0.9),
        EquirectangularCamera(2400, 1200),
    ],
    ids=lambda camera: type(camera).__name__,
)
def test_every_camera(camera):
    scene = Scene(camera, THREE)
    pose = estimate_pose(camera, scene.images, scene.surfaces)
    assert_close(pose, scene, 0.1, 0.008)
    assert pose.locked
    assert not pose.ambiguous


@settings(max_examples=4)
@given(
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.tuples(*[st.floats(-5e6, 5e6)] * 3),
)
def test_world_frame_does_not_matter(world, offset):
    here = Scene(CAMERA, THREE, world=(0, 0, 0))
    there = Scene(CAMERA, THREE, world=world, offset=offset)
    pose = estimate_pose(CAMERA, there.images, there.surfaces)
    assert_close(pose, there)
    reference = estimate_pose(CAMERA, here.images, here.surfaces)
    error_here = rotation_angle(reference.rotation @ here.rotation.T)
    error_there = rotation_angle(pose.rotation @ there.rotation.T)
    assert abs(error_here - error_there) < np.radians(0.02)


def test_a_crop_of_the_photo_gives_the_same_pose():
    scene = Scene(CAMERA, THREE)
    rows, columns = slice(40, 800), slice(100, 1150)
    matrix = np.array(MATRIX) - [[0, 0, 100], [0, 0, 40], [0, 0, 0]]
    cropped = PerspectiveCamera(1050, 760, matrix)
    images = [ImageRegion.from_mask(mask[rows, columns]) for mask in scene.masks]
    whole = estimate_pose(CAMERA, scene.images, scene.surfaces)
    part = estimate_pose(cropped, images, scene.surfaces)
    np.testing.assert_allclose(part.rotation, whole.rotation, atol=1e-5)
    np.testing.assert_allclose(part.centre, whole.centre, atol=1e-4)


@pytest.mark.parametrize("roll", [90, 180, -70])
def test_camera_held_any_way(roll):
    camera = PerspectiveCamera(1400, 1400, [[800, 0, 699.5], [0, 800, 699.5], [0, 0, 1]])
    scene = Scene(camera, THREE, local=exp_so3([0, 0, np.radians(roll)]) @ LOCAL, shift=[0.0, 0.1, 3.4])
    assert_close(estimate_pose(camera, scene.images, scene.surfaces), scene)


def test_one_region_wound_either_way():
    scene = Scene(CAMERA, ["ell"])
    surface = scene.surfaces[0]
    for faces in (surface.faces, surface.faces[:, ::-1]):
        pose = estimate_pose(CAMERA, scene.images[0], SurfaceRegion(surface.vertices, faces))
        assert_close(pose, scene, 0.3, 0.02)


def test_unpaired_regions_in_any_order():
    scene = Scene(CAMERA, THREE)
    pose = estimate_pose(CAMERA, scene.images[::-1], scene.surfaces, paired=False)
    assert_close(pose, scene)


def test_region_with_a_hole():
    """A window in the surface is a hole in the mask."""
    scene = Scene(CAMERA, ["ell"])
    outer = np.array(ELL) - 0.5
    inner = np.array([(0.08, 0.1), (0.25, 0.12), (0.24, 0.5), (0.1, 0.6)]) - 0.5
    n, points = len(outer), np.concatenate([outer, inner])
    faces = [(0, 1, 6), (1, 7, 6), (1, 3, 7), (1, 2, 3), (3, 8, 7), (3, 4, 8), (4, 9, 8), (4, 5, 9)]
    faces += [(5, 0, 9), (0, 6, 9)]
    space = np.column_stack([points, np.zeros(len(points))])
    pixels = CAMERA.project(space @ LOCAL.T + SHIFT)
    region = ImageRegion.from_polygon(pixels[:n], [pixels[n:]])
    world = (space - (-LOCAL.T @ SHIFT)) @ (scene.rotation.T @ LOCAL).T + scene.centre
    pose = estimate_pose(
        CAMERA, ImageRegion.from_mask(region.to_mask(1200, 800)), SurfaceRegion(world, faces)
    )
    assert_close(pose, scene, 0.1, 0.01)


def test_square_is_ambiguous_and_up_or_a_rough_pose_decides():
    scene = Scene(CAMERA, ["square"])
    pose = estimate_pose(CAMERA, scene.images, scene.surfaces)
    assert pose.ambiguous
    assert "other pose" in pose.reason
    found = [pose, *pose.alternatives]
    assert min(np.degrees(rotation_angle(p.rotation @ scene.rotation.T)) for p in found) < 0.3
    near = exp_so3([0.05, -0.1, 0.1]) @ scene.rotation
    rough = Pose(near, -near @ (scene.centre + 0.1), np.eye(6))
    decided = estimate_pose(CAMERA, scene.images, scene.surfaces, initial=rough)
    assert not decided.ambiguous
    assert_close(decided, scene, 0.3, 0.02)
    up = -scene.rotation[1]
    upright = estimate_pose(CAMERA, scene.images, scene.surfaces, up=up)
    assert all(p.rotation[1] @ up < 0 for p in (upright, *upright.alternatives))


def test_slips_of_the_hand_do_not_pull_the_pose():
    scene = Scene(CAMERA, THREE)
    generator = np.random.default_rng(4)
    for mask in scene.masks:
        v, u = np.nonzero(mask & ~np.roll(mask, 1, axis=1))
        for k in generator.integers(len(v), size=6):
            mask[v[k] - 8 : v[k] + 9, u[k] - 8 : u[k] + 9] = generator.random() < 0.5
    pose = estimate_pose(CAMERA, scene.images, scene.surfaces)
    assert_close(pose, scene)
    assert pose.overlap_error > 0.3


def test_hidden_part_of_an_outline_does_not_count():
    scene = Scene(CAMERA, THREE)
    u = np.nonzero(scene.masks[0])[1]
    hidden = np.zeros_like(scene.masks[0])
    hidden[:, : int(np.percentile(u, 30))] = True
    images = scene.images
    images[0] = ImageRegion.from_mask(scene.masks[0] & ~hidden, "ell", hidden)
    pose = estimate_pose(CAMERA, images, scene.surfaces)
    assert_close(pose, scene)


def test_region_cut_off_by_the_photo_helps_beside_a_whole_one():
    scene = Scene(CAMERA, THREE, shift=[-2.05, 0.1, 3.4])
    touching = [mask[:, 0].any() for mask in scene.masks]
    assert any(touching)
    assert not all(touching)
    assert_close(estimate_pose(CAMERA, scene.images, scene.surfaces), scene)
    alone = touching.index(True)
    with pytest.raises(RegionError, match="touches the edge of the photo"):
        estimate_pose(CAMERA, scene.images[alone], scene.surfaces[alone])


def test_region_across_the_seam_of_a_panorama():
    camera = EquirectangularCamera(2400, 1200)
    about = exp_so3([0, np.pi, 0])
    scene = Scene(camera, THREE, local=about @ LOCAL, shift=about @ SHIFT)
    # The seam splits an outline that is filled in pixels: turn the panorama that looks ahead instead.
    ahead = Scene(EquirectangularCamera(2400, 1200), THREE)
    scene.masks = [np.roll(mask, 1200, axis=1) for mask in ahead.masks]
    assert any(mask[:, 0].any() and mask[:, -1].any() for mask in scene.masks)
    assert_close(estimate_pose(camera, scene.images, scene.surfaces), scene, 0.1, 0.008)


def test_focal_length_from_three_regions():
    scene = Scene(CAMERA, THREE)
    guess = PerspectiveCamera(1200, 800, [[1050, 0, 599.5], [0, 1050, 399.5], [0, 0, 1]])
    found = estimate_pose_and_focal(guess, scene.images, scene.surfaces)
    assert found.camera.K[0, 0] == pytest.approx(800, rel=2e-3)
    assert abs(found.camera.K[0, 0] - 800) < 4 * found.focal_sigma
    assert_close(found.pose, scene, 0.1, 0.015)


def test_focal_length_is_refused_where_it_cannot_be_told():
    scene = Scene(CAMERA, THREE)
    with pytest.raises(RegionError, match="at least three regions"):
        estimate_pose_and_focal(CAMERA, scene.images[:2], scene.surfaces[:2])
    flat = [
        SurfaceRegion(s.vertices * [1, 1, 0], s.faces) for s in Scene(CAMERA, THREE, world=(0, 0, 0)).surfaces
    ]
    with pytest.raises(RegionError, match="nearly in one plane"):
        estimate_pose_and_focal(CAMERA, scene.images, flat)


def test_wrong_partner_is_no_pose():
    scene = Scene(CAMERA, ["ell", "gable"])
    with pytest.raises(PoseNotFound):
        estimate_pose(CAMERA, scene.images, [scene.surfaces[1], scene.surfaces[0]])


def test_partners_missing():
    scene = Scene(CAMERA, ["ell", "gable"])
    with pytest.raises(RegionError, match="needs its partner"):
        estimate_pose(CAMERA, scene.images, scene.surfaces[:1])
    with pytest.raises(RegionError, match="at least one region"):
        estimate_pose(CAMERA, [], [])


@pytest.mark.parametrize(
    ("shape", "rows", "message"),
    [
        ((800, 1200), slice(0, 300), "touches the edge"),
        ((800, 1200), slice(400, 401), "only 3 pixels"),
        ((400, 600), slice(100, 200), "600 x 400 pixels, the photo 1200 x 800"),
    ],
)
def test_masks_that_cannot_be_used(shape, rows, message):
    mask = np.zeros(shape, dtype=bool)
    mask[rows, 500:503] = True
    surface = SurfaceRegion(np.column_stack([ELL, np.zeros(6)]), [(0, 1, 2), (0, 2, 3)])
    with pytest.raises(RegionError, match=message):
        estimate_pose(CAMERA, ImageRegion.from_mask(mask, "door"), surface)


def test_job_tells_its_progress_and_gives_the_same_pose():
    scene = Scene(CAMERA, THREE)
    seen = []
    pose = jobs.drain(estimate_pose_job(CAMERA, scene.images, scene.surfaces), seen.append)
    fractions = [step.fraction for step in seen]
    assert fractions == sorted(fractions)
    assert len(fractions) >= 3
    again = estimate_pose(CAMERA, scene.images, scene.surfaces)
    np.testing.assert_array_equal(pose.rotation, again.rotation)


def test_covariance_is_that_of_rotation_and_centre():
    """Errors over several exact scenes stay within what the covariance says."""
    squares = []
    for k in range(4):
        scene = Scene(CAMERA, THREE, shift=SHIFT + 0.05 * k)
        pose = estimate_pose(CAMERA, scene.images, scene.surfaces)
        turn = pose.rotation @ scene.rotation.T
        small = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
        error = np.concatenate([small, pose.centre - scene.centre])
        squares.append(error @ np.linalg.solve(pose.covariance, error))
    assert 0.3 < np.mean(squares) < 20


def test_poses_are_plain_data():
    scene = Scene(CAMERA, THREE)
    pose = estimate_pose(CAMERA, scene.images, scene.surfaces)
    assert replace(pose, ambiguous=True).ambiguous
    assert len(pose.region_errors) == 3
    assert pose.overlap_error < 0.5


def cut_in_half(scene, index):
    """Images of which one shows only the left half of its region, and does not say so."""
    images = scene.images
    mask = scene.masks[index].copy()
    mask[:, int(np.median(np.nonzero(mask)[1])) :] = False
    images[index] = ImageRegion.from_mask(mask, scene.names[index])
    return images


@pytest.mark.parametrize("index", [0, 1, 2])
def test_region_half_hidden_without_saying_so_is_told_by_name(index):
    scene = Scene(CAMERA, THREE)
    pose = estimate_pose(CAMERA, cut_in_half(scene, index), scene.surfaces)
    assert_close(pose, scene)
    assert not pose.ambiguous
    assert len(pose.remarks) == 1
    assert f"Region '{THREE[index]}'" in pose.remarks[0]
    assert "mark what hides it" in pose.remarks[0]
    assert [not error < 5 for error in pose.region_errors] == [k == index for k in range(3)]


def test_of_two_regions_the_half_hidden_one_is_told():
    scene = Scene(CAMERA, ["ell", "prow"])
    pose = estimate_pose(CAMERA, cut_in_half(scene, 1), scene.surfaces)
    assert_close(pose, scene, 0.2, 0.02)
    assert "Region 'prow'" in pose.remarks[0]


def test_one_region_half_hidden_is_refused_or_told():
    scene = Scene(CAMERA, ["prow"])
    try:
        pose = estimate_pose(CAMERA, cut_in_half(scene, 0), scene.surfaces)
    except PoseNotFound:
        return
    assert pose.ambiguous
    assert pose.reason


def test_region_with_another_partner_is_left_out_by_name():
    scene = Scene(CAMERA, THREE)
    surfaces = [*scene.surfaces[:2], Scene(CAMERA, ["square"]).surfaces[0]]
    pose = estimate_pose(CAMERA, scene.images, surfaces)
    assert_close(pose, scene)
    assert "Region 'gable'" in pose.remarks[0]


def test_region_cut_off_by_the_photo_has_no_error_of_its_own():
    scene = Scene(CAMERA, THREE, shift=[-2.05, 0.1, 3.4])
    pose = estimate_pose(CAMERA, scene.images, scene.surfaces)
    cut = [bool(mask[:, 0].any()) for mask in scene.masks]
    assert [bool(np.isnan(error)) for error in pose.region_errors] == cut
    unpaired = estimate_pose(CAMERA, Scene(CAMERA, THREE).images, Scene(CAMERA, THREE).surfaces, paired=False)
    assert len(unpaired.region_errors) == 3
    assert np.all(np.isnan(unpaired.region_errors))


def test_wrong_hints_do_not_give_a_wrong_pose_silently():
    """A false up direction is contradicted; a false rough pose is outvoted by the outlines."""
    scene = Scene(CAMERA, ["ell"])
    down = estimate_pose(CAMERA, scene.images, scene.surfaces, up=scene.rotation[1])
    assert down.ambiguous
    assert "pointing down" in down.reason
    assert_close(down, scene, 0.3, 0.02)
    for turn in ([2.5, 0.0, 0.0], [0.0, 0.9, 0.4]):
        false = exp_so3(turn) @ scene.rotation
        rough = Pose(false, -false @ (scene.centre + 1.0), np.eye(6))
        assert_close(estimate_pose(CAMERA, scene.images, scene.surfaces, initial=rough), scene, 0.3, 0.02)


@pytest.mark.parametrize(
    "camera",
    [
        PerspectiveCamera(1200, 800, MATRIX, [-0.2, 0.05, 0.001, -0.002]),
        FisheyeCamera(1200, 800, [[500, 0, 599.5], [0, 500, 399.5], [0, 0, 1]], [0.02, -0.01]),
        PolynomialCamera(1200, 800, [599.5, 399.5], [500.0, 0.0, -6e-4]),
        CatadioptricCamera(1200, 800, [[1000, 0, 599.5], [0, 1000, 399.5], [0, 0, 1]], 0.9),
        EquirectangularCamera(4800, 2400),
    ],
    ids=lambda camera: type(camera).__name__,
)
def test_one_region_upside_down_and_far_from_the_origin(camera):
    local = exp_so3([0, 0, np.pi]) @ LOCAL
    scene = Scene(camera, ["prow"], offset=(10_000.0, -8_000.0, 300.0), local=local, shift=[0.1, 0.1, 2.4])
    pose = estimate_pose(camera, scene.images, scene.surfaces)
    assert_close(pose, scene, 0.15, 0.01)
    assert pose.locked


def test_a_disc_is_told_to_be_too_round():
    angle = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    ring = 0.5 * np.column_stack([np.cos(angle), 0.7 * np.sin(angle), np.zeros(90)])
    faces = [(0, k, k + 1) for k in range(1, 89)]
    pixels = CAMERA.project(ring @ LOCAL.T + SHIFT)
    region = ImageRegion.from_mask(ImageRegion.from_polygon(pixels).to_mask(1200, 800), "clock")
    pose = estimate_pose(CAMERA, region, SurfaceRegion(ring, faces))
    assert pose.ambiguous


def test_polygons_drawn_by_hand_say_how_far_they_may_be_off():
    """Corners are off by pixels, so that whole sides are: no lock in pieces, and errors within 3 sigma."""
    generator = np.random.default_rng(3)
    squares = []
    for _ in range(3):
        scene = Scene(CAMERA, THREE)
        images = []
        for surface in scene.surfaces:
            corners = CAMERA.project(surface.vertices @ scene.rotation.T + scene.translation)
            images.append(ImageRegion.from_polygon(corners + generator.normal(0, 1.5, corners.shape)))
        pose = estimate_pose(CAMERA, images, scene.surfaces)
        error = np.concatenate([log_so3(pose.rotation @ scene.rotation.T), pose.centre - scene.centre])
        squares.append(error @ np.linalg.solve(pose.covariance, error))
        assert np.degrees(rotation_angle(pose.rotation @ scene.rotation.T)) < 3 * pose.rotation_sigma
    assert np.mean(squares) < 20
