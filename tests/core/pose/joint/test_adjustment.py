"""The adjustment's derivatives, its minimum, and its covariances, on made-up tracks."""

from dataclasses import replace

import numpy as np
import pytest
from fresco.core.geometry.rigid import exp_so3, log_so3
from fresco.core.pose.joint.adjustment import (
    Network,
    Noise,
    Prior,
    Problem,
    ScanTies,
    adjust,
    covariances,
    estimate_noise,
    without_outliers,
)
from fresco.core.pose.joint.lens import shared_lenses
from fresco.core.pose.joint.tracks import Tracks
from fresco.core.settings import JointSettings

FOCAL = 1000.0


def made_up(rng, cameras=4, points=60, pixel=0.3, scan=0.003):
    """True network, and the problem with noisy rays and scan ties."""
    rotations = exp_so3(rng.normal(0, 0.05, (cameras, 3)))
    centres = np.stack([np.linspace(-2, 2, cameras), rng.normal(0, 0.3, cameras), np.zeros(cameras)], axis=1)
    world = np.stack(
        [rng.uniform(-2, 2, points), rng.uniform(-1.5, 1.5, points), rng.uniform(5, 7, points)], axis=1
    )
    view = np.tile(np.arange(cameras), points)
    track = np.repeat(np.arange(points), cameras)
    in_camera = np.einsum("mij,mj->mi", rotations[view], world[track] - centres[view])
    plane = in_camera[:, :2] / in_camera[:, 2:] + rng.normal(0, pixel / FOCAL, (len(view), 2))
    rays = np.column_stack([plane, np.ones(len(view))])
    z = 1 / np.linalg.norm(rays, axis=1)
    rays *= z[:, None]
    to_pixels = np.zeros((len(view), 2, 3))
    to_pixels[:, 0, 0] = to_pixels[:, 1, 1] = FOCAL / z
    to_pixels[:, :, 2] = -FOCAL * plane / z[:, None]
    normals = rng.normal(size=(points, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    feet = world + rng.normal(0, scan, (points, 1)) * normals
    tracks = Tracks(view, track, track, FOCAL * plane, rays, to_pixels, np.ones(len(view)))
    prior = Prior(rotations, centres, np.tile(np.eye(6) * 1e-6, (cameras, 1, 1)))
    ties = ScanTies(feet, normals, np.ones(points))
    problem = Problem(tracks, ties, prior, Noise(pixel, scan), shared_lenses([], False, JointSettings()))
    return Network(rotations, centres, world), problem


def test_gradient_matches_finite_differences():
    rng = np.random.default_rng(0)
    network, problem = made_up(rng)
    network = network.moved(rng.normal(0, 1e-3, (4, 6)), rng.normal(0, 1e-3, (60, 3)))
    system = problem.linearise(network)
    for _ in range(5):
        cameras, points = rng.normal(size=(4, 6)), rng.normal(size=(60, 3))
        h = 1e-6
        plus = problem.linearise(network.moved(h * cameras, h * points)).cost
        minus = problem.linearise(network.moved(-h * cameras, -h * points)).cost
        slope = 2 * ((system.camera_gradient * cameras).sum() + (system.point_gradient * points).sum())
        assert (plus - minus) / (2 * h) == pytest.approx(slope, rel=1e-4)


def test_disturbed_network_returns():
    rng = np.random.default_rng(1)
    truth, problem = made_up(rng, pixel=1e-4, scan=1e-6)
    start = truth.moved(rng.normal(0, 3e-3, (4, 6)), rng.normal(0, 1e-2, (60, 3)))
    solved = adjust(problem, start, iterations=60)
    assert np.abs(solved.centres - truth.centres).max() < 1e-4


def test_covariances_are_calibrated():
    rng = np.random.default_rng(2)
    normalised = []
    for _ in range(15):
        truth, problem = made_up(rng)
        solved = adjust(problem, truth)
        for k, covariance in enumerate(covariances(problem, solved)[0]):
            turned = log_so3(truth.rotations[k] @ solved.rotations[k].T)
            error = np.concatenate([turned, truth.centres[k] - solved.centres[k]])
            normalised.append(error @ np.linalg.solve(covariance, error))
    assert 4 < np.mean(normalised) < 9


def test_mismatches_are_dropped():
    rng = np.random.default_rng(3)
    truth, problem = made_up(rng)
    problem.tracks.rays[::17] = np.roll(problem.tracks.rays, 5, axis=0)[::17]
    solved = adjust(problem, truth)
    cleaned, kept = without_outliers(problem, solved, limit=4.0)
    final = adjust(cleaned, kept)
    assert cleaned.tracks.count <= problem.tracks.count
    assert len(cleaned.tracks.view) < len(problem.tracks.view) - 10
    assert np.abs(final.centres - truth.centres).max() < 0.02


def test_sightings_that_err_together_count_as_fewer():
    """White errors leave the count as it is; a lens that is off a little does not."""
    rng = np.random.default_rng(4)
    truth, problem = made_up(rng, points=800)
    independent = estimate_noise(problem, adjust(problem, truth))
    assert independent.alike < 1.5
    tracks = problem.tracks
    off = 0.3 * np.sin(tracks.pixels / 90.0 + tracks.view[:, None])
    turned = tracks.rays + np.einsum("mij,mi->mj", tracks.to_pixels, off) / FOCAL**2
    lens_off = replace(problem, tracks=replace(tracks, rays=turned))
    solved = adjust(lens_off, truth)
    together = estimate_noise(lens_off, solved)
    assert together.alike > 3
    doubt = [
        covariances(replace(lens_off, noise=n), solved)[0] for n in (replace(together, alike=1.0), together)
    ]
    assert (doubt[1].trace(axis1=1, axis2=2) > 1.5 * doubt[0].trace(axis1=1, axis2=2)).all()
