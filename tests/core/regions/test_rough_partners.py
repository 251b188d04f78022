"""Partners by poses that are known only roughly: random offsets as large as the poses say."""

import numpy as np
import pytest
from fresco.core.cameras import EquirectangularCamera
from fresco.core.geometry.rigid import camera_centre, exp_so3
from fresco.core.jobs import drain
from fresco.core.photos.rough_pose import RoughPose
from fresco.core.regions import ImageRegion
from fresco.core.regions.rough_partners import propose_rough_partners_job
from photo_scenes import CAMERA, SHIFT, TURN, rectangle

WALL = [
    rectangle(-2, -1, 1.2, 1.6, name="door"),
    rectangle(0.4, -1.2, 1.5, 0.8, name="panel"),
    rectangle(-0.3, 0.4, 1.9, 0.5, depth=-0.4, name="sill"),
    rectangle(4.5, -1, 1.0, 1.0, name="outside"),
    rectangle(-7, -1, 1.2, 1.6, name="like the door"),
]
SEEN = [2, 0, 1]
METRES, DEGREES = 0.8, 8.0
COVARIANCE = np.diag([np.radians(DEGREES) ** 2] * 3 + [METRES**2] * 3)


def seen(numbers=SEEN, noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    corners = [CAMERA.project(WALL[k].vertices @ TURN.T + SHIFT) for k in numbers]
    return [ImageRegion.from_polygon(loop + rng.normal(0, noise, loop.shape)) for loop in corners]


def disturbed(seed, covariance=COVARIANCE):
    rng = np.random.default_rng(seed)
    offset = rng.multivariate_normal(np.zeros(6), covariance)
    rotation = exp_so3(offset[:3]) @ TURN
    return RoughPose(rotation, -rotation @ (camera_centre(TURN, SHIFT) + offset[3:]), covariance, "test")


def turned(angle, covariance):
    """Rough pose from the right place, turned by an angle (rad) to the side."""
    rotation = exp_so3([0, angle, 0]) @ TURN
    return RoughPose(rotation, -rotation @ camera_centre(TURN, SHIFT), covariance, "test")


def best(poses, images, **more):
    return drain(propose_rough_partners_job(CAMERA, poses, images, WALL, **more))


def test_regions_find_their_partners_within_the_pose_s_uncertainty():
    shifts, right = [], 0
    for seed in range(12):
        rough = disturbed(seed)
        found = best([rough], seen(noise=1.5, seed=seed))
        right += bool(found) and {(i, j) for i, j, _ in found[0].pairs} == {(0, 2), (1, 0), (2, 1)}
        middle = WALL[1].centre
        gap = CAMERA.project(middle @ rough.rotation.T + rough.translation) - CAMERA.project(
            middle @ TURN.T + SHIFT
        )
        shifts.append(np.linalg.norm(gap))
    assert right >= 11
    assert (
        np.median(shifts) > 100
    )  # pixels: where they are projected they overlap with nothing, or a wrong one


def test_the_pose_that_explains_them_is_nearer_the_truth_than_the_rough_one():
    rough = disturbed(3)
    found = best([rough], seen())[0]
    before = np.linalg.norm(camera_centre(rough.rotation, rough.translation) - camera_centre(TURN, SHIFT))
    after = np.linalg.norm(camera_centre(found.rotation, found.translation) - camera_centre(TURN, SHIFT))
    assert after < 0.5 * before and found.doubt == 0 and 0 < found.deviations < 6
    assert all(share > 0.85 for _, _, share in found.pairs)


def test_one_region_that_may_be_two_has_a_rival():
    wide = np.diag([np.radians(4.0) ** 2] * 3 + [4.0**2] * 3)
    found = best([disturbed(1, wide)], seen([0]))
    partners = [pairing.pairs[0][1] for pairing in found]
    assert {0, 4} <= set(partners) and found[1].doubt > 0


def test_far_from_where_it_may_be_nothing_is_proposed():
    sure = np.diag([np.radians(0.5) ** 2] * 3 + [0.05**2] * 3)
    assert best([turned(0.4, sure)], seen()) == []
    assert best([turned(np.pi, sure)], seen()) == []


def test_the_better_of_several_rough_poses_counts():
    sure = np.diag([np.radians(1.0) ** 2] * 3 + [0.1**2] * 3)
    found = best([turned(0.4, sure), disturbed(2, sure)], seen())
    assert len(found) == 1 and len(found[0].pairs) == 3


@pytest.mark.parametrize("offset", [0.0, 5.0e6])
def test_large_coordinates_make_no_difference(offset):
    rough, shift = disturbed(4), np.array([offset, offset, 0.0])
    moved = [type(s)(s.vertices + shift, s.faces, s.name) for s in WALL]
    pose = RoughPose(rough.rotation, rough.translation - rough.rotation @ shift, COVARIANCE, "test")
    found = drain(propose_rough_partners_job(CAMERA, [pose], seen(), moved))
    assert {(i, j) for i, j, _ in found[0].pairs} == {(0, 2), (1, 0), (2, 1)}


def test_over_the_seam_of_a_panorama_it_is_not_far():
    camera = EquirectangularCamera(2000, 1000)
    middle = TURN @ WALL[0].centre + SHIFT
    beside = np.pi - np.radians(9.0) - np.arctan2(middle[0], middle[2])
    rotation, rough = (exp_so3([0, beside + more, 0]) for more in (0.0, np.radians(18.0)))
    loop = camera.project(WALL[0].vertices @ (rotation @ TURN).T + rotation @ SHIFT)
    pose = RoughPose(rough @ TURN, rough @ SHIFT, COVARIANCE, "test")
    images = [ImageRegion.from_polygon(loop)]
    (found,) = drain(propose_rough_partners_job(camera, [pose], images, WALL[:1]))
    assert found.pairs[0][:2] == (0, 0) and found.pairs[0][2] > 0.85
