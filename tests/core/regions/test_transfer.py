import numpy as np
import pytest
from fresco.core.errors import RegionError
from fresco.core.geometry.rays import RayCaster
from fresco.core.geometry.rigid import exp_so3
from fresco.core.regions import ImageRegion
from fresco.core.regions.transfer import overlap, project_region, transfer_region
from photo_scenes import CAMERA, SHIFT, SURFACES, TURN, photo_of, rectangle


def test_the_outline_is_projected_where_the_photo_shows_it():
    for surface in SURFACES:
        loops = project_region(CAMERA, TURN, SHIFT, surface)
        exact = CAMERA.project(surface.vertices @ TURN.T + SHIFT)
        assert ImageRegion(loops).area > 0
        assert overlap(ImageRegion(loops), ImageRegion.from_polygon(exact), CAMERA) > 0.995


def test_a_wrong_pose_gives_a_seed_that_snaps_to_the_right_outline():
    image = photo_of(SURFACES)
    truth = ImageRegion.from_polygon(CAMERA.project(SURFACES[1].vertices @ TURN.T + SHIFT))
    off = exp_so3([0.004, -0.004, 0.002])
    found = transfer_region(image, CAMERA, off @ TURN, off @ SHIFT, SURFACES[1], reach=10)
    assert overlap(found.seed, truth, CAMERA) < 0.97
    assert overlap(found.region, truth, CAMERA) > 0.985
    assert 1 < found.shift < 10


def test_transfer_refuses_what_it_cannot_know():
    image = photo_of(SURFACES)
    with pytest.raises(RegionError, match="cut off"):
        transfer_region(image, CAMERA, TURN, SHIFT + np.array([3, 0, 0]), SURFACES[1], reach=10)
    with pytest.raises(RegionError, match="in front"):
        transfer_region(image, CAMERA, TURN, SHIFT - np.array([0, 0, 20]), SURFACES[1], reach=10)
    screen = rectangle(-5, -5, 10, 10, depth=-1.0)
    scene = RayCaster(screen.vertices, screen.faces)
    with pytest.raises(RegionError, match="hidden"):
        transfer_region(image, CAMERA, TURN, SHIFT, SURFACES[1], 10, scene)
