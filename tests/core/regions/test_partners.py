import numpy as np
import pytest
from fresco.core.errors import PoseNotFound, RegionError
from fresco.core.geometry.rigid import exp_so3
from fresco.core.jobs import Progress, drain
from fresco.core.pose import estimate_pose
from fresco.core.regions import ImageRegion
from fresco.core.regions.partners import Shapes, partners_at, propose_pairings_job
from photo_scenes import CAMERA, SHIFT, SURFACES, TURN, rectangle


def test_partners_at_a_pose_overlap_and_what_is_behind_the_camera_has_none():
    images = [
        ImageRegion.from_polygon(CAMERA.project(s.vertices @ TURN.T + SHIFT)) for s in reversed(SURFACES)
    ]
    rough = exp_so3([0.02, 0.01, 0]) @ TURN
    behind = rectangle(0, 0, 1, 1, depth=-50)
    pairs = partners_at(CAMERA, rough, SHIFT, Shapes(CAMERA, images), [*SURFACES, behind], 0.3)
    assert {(i, j) for i, j, _ in pairs} == {(0, 1), (1, 0)}
    assert all(0.5 < share < 1 for _, _, share in pairs)


def solve(images, surfaces):
    return estimate_pose(CAMERA, images, surfaces)


PLACED = [*SURFACES, rectangle(-0.2, 0.4, 1.7, 0.7, depth=-0.5, name="sill")]


def seen(surfaces):
    return [ImageRegion.from_polygon(CAMERA.project(s.vertices @ TURN.T + SHIFT)) for s in surfaces]


def test_pairings_are_tried_scored_and_the_true_one_is_first():
    stranger = rectangle(3, 3, 0.3, 2.0, name="stranger")
    scan = [stranger, *reversed(PLACED)]
    found = drain(propose_pairings_job(CAMERA, solve, seen(PLACED), scan))
    assert found[0].pairs == ((0, 3), (1, 2), (2, 1)) and found[0].error < 0.5
    assert np.allclose(found[0].pose.rotation, TURN, atol=1e-3)
    assert [-len(p.pairs) for p in found] == sorted(-len(p.pairs) for p in found)


def test_regions_that_have_no_pose_together_are_not_proposed():
    def never(images, surfaces):
        raise PoseNotFound("no pose")

    assert drain(propose_pairings_job(CAMERA, never, seen(PLACED), PLACED)) == []


def test_pairing_refuses_nothing_and_too_much_and_can_be_stopped():
    with pytest.raises(RegionError, match="Mark regions"):
        drain(propose_pairings_job(CAMERA, solve, [], PLACED))
    with pytest.raises(RegionError, match="108 pairs are too many"):
        drain(propose_pairings_job(CAMERA, solve, seen(PLACED) * 4, PLACED * 3))
    job = propose_pairings_job(CAMERA, solve, seen(PLACED), PLACED)
    assert isinstance(next(job), Progress)
    job.close()
