"""Lenses adjusted with the poses: derivatives, recovery, calibrated doubt, refusal where they are open."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from fresco.core.cameras import (
    CatadioptricCamera,
    EquirectangularCamera,
    FisheyeCamera,
    PerspectiveCamera,
    PolynomialCamera,
)
from fresco.core.cameras.base import Camera
from fresco.core.geometry.rigid import exp_so3
from fresco.core.pose import refine_poses_jointly
from fresco.core.pose.joint.adjustment import (
    Network,
    Noise,
    Prior,
    Problem,
    ScanTies,
    adjust,
    covariances,
)
from fresco.core.pose.joint.lens import (
    changed_camera,
    fitted_lens,
    pixel_slopes,
    shared_lenses,
    why_fixed,
)
from fresco.core.pose.joint.tracks import Tracks
from fresco.core.settings import JointSettings

K = [[1000, 0, 499.5], [0, 1000, 374.5], [0, 0, 1]]
CAMERAS = [
    PerspectiveCamera(1000, 750, K, (0.01, -0.02)),
    FisheyeCamera(1000, 750, [[400, 0, 499.5], [0, 400, 374.5], [0, 0, 1]], (0.02, -0.01)),
    CatadioptricCamera(1000, 750, [[600, 0, 499.5], [0, 600, 374.5], [0, 0, 1]], 0.8),
    PolynomialCamera(1000, 750, (500, 375), (600.0, 0.0, -4e-4)),
]


@dataclass(frozen=True)
class Photo:
    camera: Camera


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda c: type(c).__name__)
def test_slopes_predict_a_changed_lens(camera):
    rays = camera.unproject(np.random.default_rng(0).uniform((50, 50), (950, 700), (200, 2)))
    change = np.array([2e-4, 0.3, -0.2, 1e-4, -2e-4])
    moved = changed_camera(camera, change).project(rays) - camera.project(rays)
    assert np.abs(moved).max() > 0.2
    assert pixel_slopes(camera, np.zeros(5), rays) @ change == pytest.approx(moved, abs=2e-3)


def test_panorama_has_no_lens():
    assert "panorama" in why_fixed(EquirectangularCamera(2000, 1000))
    assert not any(shared_lenses([Photo(EquirectangularCamera(2000, 1000))], True, JointSettings()).free)


def test_cameras_of_equal_values_are_one_lens():
    twin = PerspectiveCamera(1000, 750, K, (0.01, -0.02))
    other = PerspectiveCamera(1000, 750, K, (0.01, -0.03))
    lenses = shared_lenses([Photo(c) for c in (CAMERAS[0], twin, other, CAMERAS[1])], True, JointSettings())
    assert lenses.of_view.tolist() == [0, 0, 1, 2]
    assert lenses.count == 3


def network_with_lens(rng, change, flat=False, pixel=0.3):
    """True network of ten photos and a problem whose rays are those of the camera before `change`."""
    photos, points = 10, 300
    camera = CAMERAS[0]
    true_camera = changed_camera(camera, np.asarray(change))
    rotations = exp_so3(rng.normal(0, 0.02 if flat else 0.15, (photos, 3)))
    spread = 0.3 if flat else 2.0
    centres = np.stack(
        [rng.uniform(-spread, spread, photos), rng.normal(0, 0.3, photos), np.zeros(photos)], 1
    )
    deep = rng.uniform(5, 9, points) if not flat else np.full(points, 7.0)
    world = np.stack([rng.uniform(-2.5, 2.5, points), rng.uniform(-2, 2, points), deep], axis=1)
    view, track = np.tile(np.arange(photos), points), np.repeat(np.arange(points), photos)
    in_camera = np.einsum("mij,mj->mi", rotations[view], world[track] - centres[view])
    pixels = true_camera.project(in_camera) + rng.normal(0, pixel, (len(view), 2))
    seen = np.isfinite(pixels).all(axis=1) & camera.in_frame(pixels)
    view, track, pixels = view[seen], track[seen], pixels[seen]
    rays = camera.unproject(pixels)
    to_pixels = camera.project_with_jacobian(rays)[1]
    track = np.unique(track, return_inverse=True)[1].astype(np.int64)
    world = world[np.unique(np.repeat(np.arange(points), photos)[seen])]
    tracks = Tracks(view, track, track, pixels, rays, to_pixels, np.ones(len(view)))
    normals = rng.normal(size=(len(world), 3)) if not flat else np.tile([0.0, 0, 1], (len(world), 1))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    feet = world + rng.normal(0, 0.003, (len(world), 1)) * normals
    prior = Prior(rotations, centres, np.tile(np.eye(6) * 1e2, (photos, 1, 1)))
    lenses = shared_lenses([Photo(camera)] * photos, True, JointSettings())
    ties = ScanTies(feet, normals, np.ones(len(world)))
    problem = Problem(tracks, ties, prior, Noise(pixel, 0.003), lenses)
    return Network(rotations, centres, world, np.zeros((1, 5))), problem, lenses


def test_gradient_matches_finite_differences():
    rng = np.random.default_rng(0)
    network, problem, _ = network_with_lens(rng, (1e-3, 1.0, -1.0, 0.002, 0.001))
    system = problem.linearise(network)
    pull = system.camera_gradient[:, 6:].sum(axis=0) + system.lens_gradient[0]
    for number, size in enumerate((1e-6, 1e-4, 1e-4, 1e-6, 1e-6)):
        step = np.zeros((1, 5))
        step[0, number] = size
        still = np.zeros((10, 6)), np.zeros((len(network.points), 3))
        plus = problem.linearise(network.moved(*still, step)).cost
        minus = problem.linearise(network.moved(*still, -step)).cost
        assert (plus - minus) / (2 * size) == pytest.approx(2 * pull[number], rel=1e-3)


def test_lens_is_found_and_its_doubt_is_calibrated():
    normalised = []
    for seed in range(8):
        change = np.array([1.5e-3, 2.0, -1.5, 0.004, -0.003])
        truth, problem, lenses = network_with_lens(np.random.default_rng(seed), change)
        solved = adjust(problem, truth, iterations=40)
        poses, of_lens = covariances(problem, solved)
        error = solved.lenses[0] - change
        normalised.append(error @ np.linalg.solve(of_lens[0], error))
        assert abs(error[0]) < 4e-3
        assert np.isfinite(poses).all()
    assert 2.5 < np.mean(normalised) < 9
    fit = fitted_lens(lenses.changed(solved.lenses), 0, of_lens[0], limit=2.0)
    assert not fit.note
    assert fit.camera.K[0, 0] == pytest.approx(1000 * (1 + solved.lenses[0, 0]))


def test_flat_wall_seen_from_one_place_leaves_the_lens_open():
    truth, problem, lenses = network_with_lens(np.random.default_rng(1), np.zeros(5), flat=True, pixel=1.0)
    solved = adjust(problem, truth, iterations=40)
    fit = fitted_lens(lenses.changed(solved.lenses), 0, covariances(problem, solved)[1][0], limit=2.0)
    assert "do not determine" in fit.note
    assert fit.camera is CAMERAS[0]


def test_wrong_focal_length_is_found_on_photos(wall):
    """The photos are taken with another lens than their cameras say."""
    places = [(-1.6, -4.0, 0.1), (-0.5, -3.4, 0.5), (0.5, -4.6, -0.4), (1.6, -4.0, 0.3)]
    true = PerspectiveCamera(720, 540, [[645, 0, 361.5], [0, 645, 268.5], [0, 0, 1]])
    views = [wall.view(place, camera=true, roll=0.2 * k) for k, place in enumerate(places)]
    said = PerspectiveCamera(720, 540, [[640, 0, 359.5], [0, 640, 269.5], [0, 0, 1]])
    views = [replace(view, camera=said) for view in views]
    poses = refine_poses_jointly(views, wall.vertices, wall.faces, JointSettings(features=2500), True)
    lens = poses[0].lens
    assert lens is not None
    assert not lens.note, lens.note
    assert poses[0].camera.K[0, 0] == pytest.approx(645, abs=2.5)
    assert all(np.linalg.norm(p.centre - v.centre) < 0.01 for p, v in zip(poses, views, strict=True))
