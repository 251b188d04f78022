from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.errors import PoseNotFound, RegionError
from fresco.core.geometry.rays import RayCaster
from fresco.core.geometry.rigid import exp_so3
from fresco.core.jobs import drain
from fresco.core.regions import ImageRegion, SurfaceRegion
from fresco.core.regions.feedback import expected_covariance, pose_advice, region_quality
from fresco.core.regions.proposals import (
    propose_facets_job,
    propose_image_regions_job,
    propose_openings,
    propose_pairings_job,
    propose_partners,
)
from fresco.core.regions.surface_index import index_surface
from fresco.core.regions.transfer import overlap, project_region, transfer_region
from fresco.core.regions.wand import prepare_wand

CAMERA = PerspectiveCamera(900, 600, [[800, 0, 449.5], [0, 800, 299.5], [0, 0, 1]])
TURN, SHIFT = exp_so3([0.05, -0.2, 0.02]), np.array([0.3, 0.1, 6.0])


def rectangle(u, v, width, height, depth=0.0, name=""):
    corners = np.array(
        [[u, v, depth], [u + width, v, depth], [u + width, v + height, depth], [u, v + height, depth]]
    )
    return SurfaceRegion(corners, [[0, 1, 2], [0, 2, 3]], name)


def photo_of(surfaces, camera=CAMERA, turn=TURN, shift=SHIFT):
    """Photo (H,W,3) with each rectangle in its own colour on a grey ground; drawn 4 times larger."""
    image = np.full((camera.height * 4, camera.width * 4, 3), 150, dtype=np.uint8)
    for number, surface in enumerate(surfaces):
        pixels = camera.project(surface.vertices @ turn.T + shift)
        corners = np.round((pixels + 0.5) * 4 - 0.5).astype(np.int32)
        cv2.fillPoly(image, [corners], (60 + 40 * number, 90, 200 - 50 * number))
    small = cv2.resize(image, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    return np.clip(small + np.random.default_rng(0).normal(0, 2, small.shape), 0, 255).astype(np.uint8)


SURFACES = [rectangle(-2, -1, 1.2, 1.6, name="door"), rectangle(0.4, -1.2, 1.5, 0.8, name="panel")]


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


def room(step=0.05):
    """Two walls at right angles, 4 x 3 and 3 x 3 m, the first with a window of 1 x 1.2 m: vertices, faces."""
    columns, rows = round(7 / step) + 1, round(3 / step) + 1
    u, v = np.meshgrid(np.arange(columns) * step, np.arange(rows) * step)
    vertices = np.stack([np.minimum(u, 4).ravel(), v.ravel(), np.maximum(u - 4, 0).ravel()], axis=1)
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate(
        [np.stack([a, a + 1, a + columns], 1), np.stack([a + 1, a + columns + 1, a + columns], 1)]
    )
    middle = np.stack([u.ravel(), v.ravel()], axis=1)[faces].mean(axis=1)
    window = (np.abs(middle[:, 0] - 2) < 0.5) & (np.abs(middle[:, 1] - 1.5) < 0.6)
    vertices += np.random.default_rng(0).normal(0, 0.001, vertices.shape)
    return vertices, faces[~window]


def test_the_walls_of_a_room_are_proposed():
    vertices, faces = room()
    found = drain(propose_facets_job(index_surface(vertices, faces), vertices, faces))
    assert len(found) == 2
    assert [p.area for p in found] == pytest.approx([4 * 3 - 1.2, 9], rel=0.05)


def test_a_window_is_proposed_and_the_scan_s_border_is_not():
    vertices, faces = room()
    found = propose_openings(vertices, faces, least_area=0.1)
    assert len(found) == 1
    assert found[0].area == pytest.approx(1.2, rel=0.05)
    assert np.allclose(found[0].region.centre, [2, 1.5, 0], atol=0.05)


def test_the_photo_s_frames_are_proposed():
    image = photo_of(SURFACES)
    levels = drain(propose_image_regions_job(prepare_wand(image)))
    for surface in SURFACES:
        truth = ImageRegion.from_polygon(CAMERA.project(surface.vertices @ TURN.T + SHIFT))
        shares = [overlap(ImageRegion.from_polygon(level.outline), truth, CAMERA) for level in levels]
        assert max(shares) > 0.95


def test_round_square_thin_tiny_and_cut_regions_are_told_apart():
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    disc = ImageRegion.from_polygon(np.stack([np.cos(angle), np.sin(angle) * 0.6], 1) * 100 + 300)
    assert region_quality(disc, 900, 600).symmetry == 0
    square = ImageRegion.from_polygon([[100, 100], [300, 110], [300, 310], [100, 300]])
    assert region_quality(square, 900, 600).symmetry == 4
    odd = ImageRegion.from_polygon([[100, 100], [400, 100], [400, 180], [200, 180], [200, 400], [100, 400]])
    quality = region_quality(odd, 900, 600)
    assert quality.symmetry == 1 and quality.advice == ""
    assert quality.area == pytest.approx(300 * 80 + 100 * 220)
    thin = ImageRegion.from_polygon([[10, 10], [800, 12], [800, 15], [10, 13]])
    assert "thin" in region_quality(thin, 900, 600).advice
    tiny = ImageRegion.from_polygon([[10, 10], [14, 10], [14, 14]])
    assert "small" in region_quality(tiny, 900, 600).advice
    cut = ImageRegion.from_polygon([[-10, 100], [300, 100], [250, 300]])
    assert "cut off" in region_quality(cut, 900, 600).advice


def numeric_information(surfaces, sigma, correlation):
    """J^T J / sigma² of the outline's motion across itself, by finite differences of the projection."""
    from fresco.core.geometry.contours import resampled

    total = np.zeros((6, 6))
    centre = -TURN.T @ SHIFT
    for surface in surfaces:
        loop = surface.loops[0]
        length = np.linalg.norm(np.diff(loop, axis=0, append=loop[:1]), axis=1).sum()
        points = resampled(loop, length / 400)
        at = CAMERA.project(points @ TURN.T + SHIFT)
        along = 0.5 * (np.roll(at, -1, 0) - np.roll(at, 1, 0))
        step = np.linalg.norm(along, axis=1)
        normal = np.stack([-along[:, 1], along[:, 0]], 1) / step[:, None]
        rows = np.zeros((len(points), 6))
        for k in range(6):
            delta = np.zeros(6)
            delta[k] = 1e-6
            turn = exp_so3(delta[:3]) @ TURN
            moved = CAMERA.project((points - centre - delta[3:]) @ turn.T)
            rows[:, k] = np.sum((moved - at) * normal, axis=1) / 1e-6
        total += (rows.T * np.minimum(step / correlation, 1) / sigma**2) @ rows
    return total


def test_the_expected_covariance_agrees_with_finite_differences():
    covariance = expected_covariance(CAMERA, TURN, SHIFT, SURFACES, sigma=1.5, correlation=30)
    assert np.allclose(covariance @ numeric_information(SURFACES, 1.5, 30), np.eye(6), atol=2e-3)


def test_a_second_wall_makes_the_pose_surer_and_advice_asks_for_it():
    one = expected_covariance(CAMERA, TURN, SHIFT, SURFACES[:1], sigma=5)
    text = pose_advice(one, TURN, SHIFT, SURFACES[:1])
    assert "uncertain by" in text and "another wall" in text
    more = expected_covariance(CAMERA, TURN, SHIFT, [*SURFACES, rectangle(-2, 1, 4, 0.5, depth=-2)], sigma=5)
    assert np.trace(more[3:, 3:]) < 0.3 * np.trace(one[3:, 3:])
    with pytest.raises(RegionError, match="leave the camera"):
        expected_covariance(CAMERA, TURN, SHIFT, [])
