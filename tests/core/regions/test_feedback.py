import numpy as np
import pytest
from fresco.core.errors import RegionError
from fresco.core.geometry.contours import resampled
from fresco.core.geometry.rigid import exp_so3, log_so3
from fresco.core.pose import estimate_pose
from fresco.core.regions import ImageRegion, SurfaceRegion
from fresco.core.regions.feedback import additions, expected_covariance, pose_advice, region_quality
from photo_scenes import CAMERA, SHIFT, SURFACES, TURN, rectangle
from scipy.ndimage import gaussian_filter1d


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


ELL = SurfaceRegion(
    np.array([[-2, -1, 0], [-0.8, -1, 0], [-0.8, -0.2, 0], [-1.3, -0.2, 0], [-1.3, 0.6, 0], [-2, 0.6, 0]]),
    [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]],
    "ell",
)


def marked_by_hand(surface, rng, sigma, correlation):
    """Outline as projected, every point off across it by `sigma` pixels, alike over `correlation` pixels."""
    points = resampled(CAMERA.project(resampled(surface.loops[0], 0.01) @ TURN.T + SHIFT), 1.0)
    width = correlation / np.sqrt(4 * np.pi)
    off = gaussian_filter1d(rng.normal(size=len(points)), width, mode="wrap")
    off *= sigma * np.sqrt(2 * width * np.sqrt(np.pi))
    along = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
    return ImageRegion.from_polygon(points + off[:, None] * normal)


def test_the_predicted_uncertainty_is_that_of_poses_from_marks_so_rough():
    surfaces = [ELL, rectangle(0.4, -1.2, 1.5, 0.8), rectangle(-0.2, 0.4, 1.7, 0.7, depth=-0.5)]
    covariance = expected_covariance(CAMERA, TURN, SHIFT, surfaces, sigma=1.0, correlation=20.0)
    errors = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        regions = [marked_by_hand(surface, rng, 1.0, 20.0) for surface in surfaces]
        pose = estimate_pose(CAMERA, regions, surfaces)
        centre = TURN.T @ SHIFT - pose.rotation.T @ pose.translation
        errors.append(np.concatenate([log_so3(pose.rotation @ TURN.T), centre]))
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / np.diag(covariance))
    assert np.all(ratio > 0.6) and np.all(ratio < 1.7)


def test_the_region_that_helps_most_is_named_and_does_help():
    marked = [rectangle(-0.5, -0.5, 1, 0.7)]
    near = rectangle(-0.4, 0.3, 0.8, 0.4, name="beside it")
    before = rectangle(-0.8, -0.5, 1.2, 0.8, depth=-1.5, name="in front")
    outside = rectangle(20, 0, 1, 1, name="not in the photo")
    others = [near, outside, before]
    found = additions(CAMERA, TURN, SHIFT, marked, others, sigma=3)
    assert [number for number, _ in found] == [2, 0]
    both = expected_covariance(CAMERA, TURN, SHIFT, [*marked, before], sigma=3)
    assert found[0][1] == pytest.approx(np.sqrt(np.linalg.eigvalsh(both[3:, 3:])[2]))
    alone = expected_covariance(CAMERA, TURN, SHIFT, marked, sigma=3)
    assert "Mark “in front” as well" in pose_advice(alone, TURN, SHIFT, marked, ("in front", found[0][1]))


def test_the_least_certain_direction_is_named_as_seen_from_the_camera():
    for axis, name in enumerate(("Position across", "Height", "Depth")):
        deviations = np.full(3, 0.01)
        deviations[axis] = 0.08
        covariance = np.zeros((6, 6))
        covariance[3:, 3:] = TURN.T @ np.diag(deviations**2) @ TURN
        said = pose_advice(covariance, TURN, SHIFT, [ELL])
        assert said.startswith(name) and "uncertain by 8 cm" in said
