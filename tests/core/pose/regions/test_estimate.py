import numpy as np
import pytest

from fresco.core.cameras import PerspectiveCamera
from fresco.core.errors import RegionError
from fresco.core.geometry.outlines import fill_loops
from fresco.core.geometry.rigid import exp_so3, rotation_angle
from fresco.core.pose import estimate_pose
from fresco.core.regions import ImageRegion, SurfaceRegion

CAMERA = PerspectiveCamera(1200, 800, [[800, 0, 599.5], [0, 800, 399.5], [0, 0, 1]])
ELL = np.array([(0, 0), (1, 0), (1, 0.3), (0.35, 0.3), (0.35, 0.8), (0, 0.8)], dtype=float)
ELL_FACES = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
PROW = np.array([(0, 0.2), (0.7, 0), (1, 0.4), (0.5, 0.9), (0.45, 0.5), (0.1, 0.65)], dtype=float)
PROW_FACES = [(0, 1, 4), (1, 2, 4), (2, 3, 4), (4, 5, 0)]
OFFSET = np.array([4_500_000.0, 5_100_000.0, 300.0])


def scene(offset=OFFSET):
    """Two regions in the world and a pose that sees both; masks sampled at pixel centres."""
    turn = exp_so3([0.4, -0.9, 1.3])
    first = np.column_stack([ELL - 0.5, np.zeros(6)])
    second = np.column_stack([PROW - 0.5, np.zeros(6)]) @ exp_so3([0.4, 0.3, 0.2]).T + [1.3, 0.4, 0.3]
    rotation = exp_so3([0.3, -0.25, 0.6]) @ turn.T
    local = exp_so3([0.3, -0.25, 0.6])
    loops = [first, second]
    masks = [
        fill_loops([CAMERA.project(loop @ local.T + [-0.6, -0.1, 3.4])], CAMERA.width, CAMERA.height)
        for loop in loops
    ]
    surfaces = [loop @ turn.T + offset for loop in loops]
    translation = np.array([-0.6, -0.1, 3.4]) - rotation @ offset
    return masks, list(zip(surfaces, (ELL_FACES, PROW_FACES), strict=True)), rotation, translation


def test_two_regions_far_from_the_origin():
    masks, surfaces, rotation, translation = scene()
    pose = estimate_pose(
        CAMERA, [ImageRegion.from_mask(m) for m in masks], [SurfaceRegion(*s) for s in surfaces]
    )
    assert np.degrees(rotation_angle(pose.rotation @ rotation.T)) < 0.03
    assert np.linalg.norm(pose.centre + rotation.T @ translation) < 0.002
    assert not pose.ambiguous
    assert pose.overlap_error < 0.5


def test_partners_missing():
    masks, surfaces, *_ = scene()
    with pytest.raises(RegionError, match="needs its partner"):
        estimate_pose(CAMERA, [ImageRegion.from_mask(m) for m in masks], SurfaceRegion(*surfaces[0]))


@pytest.mark.parametrize(
    ("rows", "message"),
    [(slice(0, 300), "touches the edge"), (slice(400, 401), "too small")],
)
def test_masks_that_cannot_be_used(rows, message):
    mask = np.zeros((800, 1200), dtype=bool)
    mask[rows, 500:503] = True
    surface = SurfaceRegion(np.column_stack([ELL, np.zeros(6)]), ELL_FACES)
    with pytest.raises(RegionError, match=message):
        estimate_pose(CAMERA, ImageRegion.from_mask(mask, "door"), surface)


def test_mask_of_another_size():
    mask = np.zeros((400, 600), dtype=bool)
    mask[100:200, 100:250] = True
    surface = SurfaceRegion(np.column_stack([ELL, np.zeros(6)]), ELL_FACES)
    with pytest.raises(RegionError, match="600 x 400 pixels, the photo 1200 x 800"):
        estimate_pose(CAMERA, ImageRegion.from_mask(mask), surface)
