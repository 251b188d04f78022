"""A ring of photos in a room, its last ones matched with the first one window apart: the loop holds."""

from dataclasses import dataclass

import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.geometry.rigid import exp_so3, log_so3
from fresco.core.jobs import drain
from fresco.core.pose.joint.adjustment import Network, Prior, covariances
from fresco.core.pose.joint.features import Features, Surface, meet_scan
from fresco.core.pose.joint.lens import shared_lenses
from fresco.core.pose.joint.solution import solve_network_job
from fresco.core.settings import JointSettings
from scipy.spatial import cKDTree

CAMERA = PerspectiveCamera(1000, 750, [[500, 0, 499.5], [0, 500, 374.5], [0, 0, 1]])
HALF = np.array([4.0, 3.0, 1.5])
PHOTOS, PIXEL = 12, 0.3
SIGMA = np.repeat([np.radians(0.2), 0.02], 3)


@dataclass(frozen=True)
class Photo:
    camera: PerspectiveCamera


def room():
    """Points (P,3) on the four walls, and the walls as a mesh with 2 mm of noise."""
    rng = np.random.default_rng(0)
    points, vertices, faces = [], [], []
    steps = np.linspace(-1, 1, 41)
    u, v = (g.ravel() for g in np.meshgrid(steps, steps[::2]))
    corner = (np.arange(20)[:, None] * 41 + np.arange(40)).ravel()
    for axis, side in ((0, -1), (0, 1), (1, -1), (1, 1)):
        for shares, into in ((rng.uniform(-1, 1, (900, 2)), points), (np.stack([u, v], 1), vertices)):
            wall = np.empty((len(shares), 3))
            wall[:, axis] = side
            wall[:, 1 - axis], wall[:, 2] = shares.T
            into.append(wall * HALF)
        start = corner + sum(len(w) for w in vertices[:-1])
        faces += [np.stack([start, start + 1, start + 42], 1), np.stack([start, start + 42, start + 41], 1)]
    mesh = np.concatenate(vertices)
    return np.concatenate(points), mesh + rng.normal(0, 0.002, mesh.shape), np.concatenate(faces)


def ring():
    """Rotations and centres of photos that look outwards from a small circle."""
    for turn in 2 * np.pi * np.arange(PHOTOS) / PHOTOS:
        forward = np.array([np.cos(turn), np.sin(turn), 0.0])
        right = np.array([np.sin(turn), -np.cos(turn), 0.0])
        yield np.stack([right, [0.0, 0.0, -1.0], forward]), -1.2 * forward + [0, 0, 0.1 * np.sin(3 * turn)]


def sightings(points, rotation, centre, rng):
    """Numbers of the points that a photo sees, and its features."""
    pixels = CAMERA.project((points - centre) @ rotation.T)
    seen = np.flatnonzero(np.isfinite(pixels).all(axis=1) & CAMERA.in_frame(pixels))
    noisy = pixels[seen] + rng.normal(0, PIXEL, (len(seen), 2))
    rays = CAMERA.unproject(noisy)
    none = np.zeros((len(seen), 128), np.uint8)
    return seen, Features(noisy, np.full(len(seen), 4.0), none, rays, CAMERA.project_with_jacobian(rays)[1])


def matched(numbers, other):
    return np.column_stack(np.intersect1d(numbers, other, return_indices=True)[1:])


def one_window_apart(points, numbers, other, window):
    """Matches of each point with what lies `window` m farther along the wall."""
    along = np.where(np.abs(points[:, :1]) == HALF[0], [[0, window, 0]], [[window, 0, 0]])
    distance, nearest = cKDTree(points[other]).query(points[numbers] + along[numbers])
    near = np.flatnonzero(distance < 0.15)
    chosen = np.unique(nearest[near], return_index=True)[1]
    return np.column_stack([near[chosen], nearest[near[chosen]]])


@pytest.mark.parametrize("window", [0.0, 0.12, 0.8], ids=["closed rightly", "a joint off", "a window off"])
def test_loop_with_a_wrong_closing(window):
    rng = np.random.default_rng(1)
    points, vertices, faces = room()
    rotations, centres = (np.array(list(part)) for part in zip(*ring(), strict=True))
    numbers, features = zip(
        *(sightings(points, r, c, rng) for r, c in zip(rotations, centres, strict=True)), strict=True
    )
    matches = {
        (i, j): matched(numbers[i], numbers[j])
        for i in range(PHOTOS)
        for j in range(i + 1, PHOTOS)
        if j - i in (1, 2, PHOTOS - 2, PHOTOS - 1)
    }
    if window:
        wrong = one_window_apart(points, numbers[0], numbers[PHOTOS - 1], window)
        assert len(wrong) > 400
        matches[0, PHOTOS - 1] = wrong
    steps = rng.normal(0, SIGMA, (PHOTOS, 6))
    start = Network(exp_so3(steps[:, :3]) @ rotations, centres + steps[:, 3:], np.zeros((0, 3)))
    prior = Prior(start.rotations, start.centres, np.tile(np.diag(SIGMA**-2), (PHOTOS, 1, 1)))
    surface = Surface.of_mesh(vertices, faces)
    hits = [meet_scan(f.rays, start.rotations[i], start.centres[i], surface) for i, f in enumerate(features)]
    lenses = shared_lenses([Photo(CAMERA)] * PHOTOS, False, JointSettings())
    solved = drain(solve_network_job(start, prior, features, hits, matches, surface, lenses, JointSettings()))
    network = solved.network
    error = np.column_stack(
        [log_so3(rotations @ np.swapaxes(network.rotations, 1, 2)), centres - network.centres]
    )
    assert np.linalg.norm(error[:, 3:], axis=1).max() < 0.015
    doubt = covariances(solved.problem, network)[0]
    normalised = np.einsum("na,nab,nb->n", error, np.linalg.inv(doubt), error)
    assert 1 < np.mean(normalised) < 12
    assert solved.ties.min() > 200
