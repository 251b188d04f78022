import numpy as np
import pytest
from fresco.core.errors import RegionError
from fresco.core.geometry.rigid import exp_so3
from fresco.core.regions import ImageRegion
from fresco.core.regions.feedback import expected_covariance, pose_advice, region_quality
from photo_scenes import CAMERA, SHIFT, SURFACES, TURN, rectangle


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
