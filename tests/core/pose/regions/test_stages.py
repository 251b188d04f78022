from dataclasses import replace

import numpy as np
from fresco.core.cameras import FisheyeCamera, PerspectiveCamera
from fresco.core.geometry.rigid import exp_so3, log_so3, rotation_angle
from fresco.core.pose.regions import ambiguity
from fresco.core.pose.regions.algebraic import Candidates, refine_by_moments
from fresco.core.pose.regions.ambiguity import chosen
from fresco.core.pose.regions.contour import LensStep, match
from fresco.core.pose.regions.covariance import world_covariance
from fresco.core.pose.regions.fitting import LEVELS, Contours, OutlineFit
from fresco.core.pose.regions.focal import with_lens
from fresco.core.pose.regions.initial import starting_poses
from fresco.core.pose.regions.pixels import fit_between_pixels
from fresco.core.pose.regions.problem import make_problem
from fresco.core.settings import PoseSettings
from region_scenes import Scene

CAMERA = PerspectiveCamera(1200, 800, [[800, 0, 599.5], [0, 800, 399.5], [0, 0, 1]], [-0.1, 0.02])
STEP = 1e-6


def problem_of(camera, names=("ell", "prow")):
    scene = Scene(camera, names)
    problem = make_problem(camera, scene.images, scene.surfaces, paired=True)
    return scene, problem, scene.rotation, scene.translation + scene.rotation @ problem.origin


def moved(rotation, translation, k, step):
    change = np.zeros(6)
    change[k] = step
    return exp_so3(change[:3]) @ rotation, translation + change[3:]


def test_moment_jacobian_against_finite_differences():
    """In a narrow and in an equal-area chart."""
    wide = FisheyeCamera(1600, 1600, [[300, 0, 799.5], [0, 300, 799.5], [0, 0, 1]])
    for camera, shift in ((CAMERA, [-0.5, 0.1, 3.4]), (wide, [0.0, 0.0, 0.22])):
        scene = Scene(camera, ["ell"], shift=shift, local=np.eye(3))
        problem = make_problem(camera, scene.images, scene.surfaces, paired=True)
        assert problem.moments[0].chart.equal_area is (camera is wide)
        rotation, translation = moved(
            scene.rotation, scene.translation + scene.rotation @ problem.origin, 1, 0.02
        )
        pair = problem.moments[0]
        _, jacobian = pair.residuals_with_jacobian(rotation[None], translation[None])
        for k in range(6):
            ends = [
                pair.residuals(*(x[None] for x in moved(rotation, translation, k, s))) for s in (STEP, -STEP)
            ]
            numeric = (ends[0] - ends[1])[0] / (2 * STEP)
            np.testing.assert_allclose(jacobian[0, :, k], numeric, atol=2e-5 * np.abs(jacobian).max())


def test_outline_distance_jacobian_against_finite_differences():
    _, problem, rotation, translation = problem_of(CAMERA)
    pair = Contours(problem).pairs(LEVELS[0], rotation, translation)[0]
    lens = [LensStep(with_lens(CAMERA, np.exp(1e-4), None), with_lens(CAMERA, np.exp(-1e-4), None), 2e-4)]
    found = match(CAMERA, pair, rotation, translation, lens)
    for k in range(6):
        ends = [match(CAMERA, pair, *moved(rotation, translation, k, s)) for s in (STEP, -STEP)]
        numeric = (ends[0].distances - ends[1].distances) / (2 * STEP)
        same = (ends[0].nearest == ends[1].nearest) & np.isfinite(numeric)
        assert same.sum() > 200
        np.testing.assert_allclose(found.jacobian[same, k], numeric[same], rtol=1e-4, atol=1e-2)
    longer = match(with_lens(CAMERA, np.exp(STEP), None), pair, rotation, translation)
    numeric = (longer.distances - found.distances) / STEP
    same = (longer.nearest == found.nearest) & np.isfinite(numeric)
    np.testing.assert_allclose(found.jacobian[same, 6], numeric[same], rtol=1e-3, atol=2e-2)


def test_starts_of_one_region_lead_to_its_pose():
    _, problem, rotation, translation = problem_of(CAMERA, ("prow",))
    (pair,) = problem.moments
    starts = starting_poses(pair.chart, pair.outline, pair.parts[0])
    best = refine_by_moments([pair], starts, 40).sorted()
    assert np.degrees(rotation_angle(best.rotations[0] @ rotation.T)) < 0.2
    np.testing.assert_allclose(best.translations[0], translation, atol=0.02)


def test_an_impossible_start_stays_out():
    _, problem, rotation, translation = problem_of(CAMERA)
    behind = Candidates(rotation[None], -translation[None], np.zeros(1))
    assert refine_by_moments(problem.moments, behind, 5).costs[0] == np.inf


def test_world_covariance_by_sampling():
    generator = np.random.default_rng(5)
    rotation, translation = exp_so3([0.3, 1.0, -0.4]), np.array([0.2, -0.5, 4.0])
    root = 1e-4 * generator.normal(size=(6, 6))
    steps = generator.normal(size=(20000, 6)) @ root.T
    turned = exp_so3(steps[:, :3]) @ rotation
    centres = -np.einsum("nij,ni->nj", turned, translation + steps[:, 3:])
    off = centres - (-rotation.T @ translation)
    expected = np.cov(np.concatenate([steps[:, :3], off], axis=1).T)
    found = world_covariance(root @ root.T, rotation, translation)
    np.testing.assert_allclose(found, expected, atol=0.05 * np.abs(expected).max())


def test_of_poses_whose_outlines_do_not_lock_the_best_comes_first():
    scene, problem, rotation, translation = problem_of(CAMERA)
    turned, shifted = exp_so3([0.0, 0.6, 0.0]) @ rotation, translation + np.array([0.4, 0.0, 0.3])
    wrong = OutlineFit(turned, shifted, 1e-6 * np.eye(6), 0.14, np.inf, 0.0, True)
    right = replace(wrong, rotation=rotation, translation=translation)
    pose = chosen(Contours(problem), [wrong, right], None, None, PoseSettings())
    np.testing.assert_allclose(pose.rotation, scene.rotation, atol=1e-9)


def test_a_weaker_lock_nearby_widens_the_covariance_and_one_far_off_is_an_alternative(monkeypatch):
    monkeypatch.setattr(ambiguity, "fits_without_sides", lambda contours, fit: (fit, []))
    _, problem, rotation, translation = problem_of(CAMERA)
    level = LEVELS[1]
    best = OutlineFit(rotation, translation, 1e-8 * np.eye(6), 0.7, level.near, 20.0, True)
    contours = Contours(problem)
    alone = chosen(contours, [best], None, None, PoseSettings())
    near = replace(best, rotation=exp_so3([0.0, 0.01, 0.0]) @ rotation, evidence=19.5)
    wide = chosen(contours, [best, near], None, None, PoseSettings())
    assert wide.rotation_sigma > 10 * alone.rotation_sigma
    assert not wide.ambiguous
    far = replace(best, rotation=exp_so3([0.0, 0.1, 0.0]) @ rotation, evidence=19.5)
    two = chosen(contours, [best, far], None, None, PoseSettings())
    assert two.ambiguous
    assert len(two.alternatives) == 1
    weak = replace(far, evidence=10.0)
    assert not chosen(contours, [best, weak], None, None, PoseSettings()).ambiguous


def test_boundary_between_pixels_is_found_closer_than_by_smoothing():
    _, problem, rotation, translation = problem_of(CAMERA)
    start = exp_so3([3e-4, -3e-4, 3e-4]) @ rotation
    turned, moved, covariance = fit_between_pixels(CAMERA, problem.outlines, start, translation)
    assert np.degrees(rotation_angle(turned @ rotation.T)) < 0.01
    error = np.concatenate([log_so3(turned @ rotation.T), moved - translation])
    assert error @ np.linalg.solve(covariance, error) < 30


def test_outlines_that_are_no_pixels_are_not_fitted_between_them():
    _, problem, rotation, translation = problem_of(CAMERA)
    pair = problem.outlines[0]
    drawn = replace(pair, outlines=tuple(loop[::5] for loop in pair.outlines))
    assert fit_between_pixels(CAMERA, [drawn], rotation, translation) is None
    away = translation + np.array([0.0, 0.05, 0.0])
    assert fit_between_pixels(CAMERA, [pair], rotation, away) is None
