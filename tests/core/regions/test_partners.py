from dataclasses import dataclass

import pytest
from fresco.core.errors import PoseNotFound, RegionError
from fresco.core.geometry.rigid import exp_so3
from fresco.core.jobs import drain
from fresco.core.regions import ImageRegion
from fresco.core.regions.partners import propose_pairings_job, propose_partners
from photo_scenes import CAMERA, SHIFT, SURFACES, TURN, rectangle


def test_partners_are_found_by_projecting_with_a_rough_pose():
    images = [
        ImageRegion.from_polygon(CAMERA.project(s.vertices @ TURN.T + SHIFT)) for s in reversed(SURFACES)
    ]
    rough = exp_so3([0.02, 0.01, 0]) @ TURN
    behind = rectangle(0, 0, 1, 1, depth=-50)
    pairs = propose_partners(CAMERA, rough, SHIFT, images, [*SURFACES, behind])
    assert {(i, j) for i, j, _ in pairs} == {(0, 1), (1, 0)}
    assert all(0.5 < share < 1 for _, _, share in pairs)


@dataclass
class Solved:
    overlap_error: float


def test_pairings_are_tried_scored_and_never_chosen():
    images = [ImageRegion.from_polygon([[0, 0], [5, 0], [5, 5]], name=n) for n in "ab"]
    surfaces = [rectangle(0, 0, 1, 1, name=n) for n in "abc"]

    def solve(some, others):
        wrong = sum(i.name != s.name for i, s in zip(some, others, strict=True))
        if others[0].name == "c":
            raise PoseNotFound("no pose")
        return Solved(1.0 + 10 * wrong)

    found = drain(propose_pairings_job(solve, images, surfaces, count=3))
    assert found[0].pairs == ((0, 0), (1, 1)) and found[0].error == 1.0
    assert [p.error for p in found] == sorted(p.error for p in found) and len(found) == 3
    with pytest.raises(RegionError, match="too many"):
        drain(propose_pairings_job(solve, images * 5, surfaces * 3))
