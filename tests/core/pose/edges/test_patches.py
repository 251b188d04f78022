"""Patches of edges: they find a known shift of the pose, tell poses apart, and see a row's neighbours."""

import cv2
import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.geometry.rigid import exp_so3
from fresco.core.pose.edges.alignment import Photo, PosePrior
from fresco.core.pose.edges.patches import patch_maps, shift_sigma
from fresco.core.pose.edges.photo_edges import EdgeField
from fresco.core.pose.edges.scan_edges import ScanEdges
from fresco.core.pose.edges.search import APART

CAMERA = PerspectiveCamera(320, 240, [[300, 0, 159.5], [0, 300, 119.5], [0, 0, 1]])
PRIOR = PosePrior(np.eye(3), np.zeros(3), np.diag(np.repeat([0.02, 0.05], 3) ** 2))


def crosses(spacing=None):
    """Upright and level edges 5 m away, at random places or in a regular pattern: pixels and normals."""
    rng = np.random.default_rng(2)
    if spacing is None:
        middles = rng.uniform([30, 30], [290, 210], (25, 2))
    else:
        middles = np.stack(np.meshgrid(np.arange(40, 281, spacing), np.arange(40, 201, spacing)), -1)
    along = np.arange(-9, 10)
    pixels, normals = [], []
    for x, y in middles.reshape(-1, 2):
        pixels += [np.stack([x + 0 * along, y + along], 1), np.stack([x + along, y + 0 * along], 1)]
        normals += [np.tile([1.0, 0.0], (19, 1)), np.tile([0.0, 1.0], (19, 1))]
    return np.concatenate(pixels), np.concatenate(normals)


def scan_edges(pixels, normals):
    rays = CAMERA.unproject(pixels)
    points = 5.0 * rays / rays[:, 2:]
    ones = np.ones(len(points))
    return ScanEdges(points, pixels, normals, ones, np.zeros(len(points), int))


def photo_of(edges, rotation):
    """A photo that shows just these edges, taken from a turned camera."""
    shown = CAMERA.project(edges.points @ rotation.T)
    field = np.zeros((240, 320), np.float32)
    column, row = np.clip(np.rint(shown).astype(int), 0, [319, 239]).T
    field[row, column] = edges.normals[:, 0] ** 2 - edges.normals[:, 1] ** 2
    field = cv2.GaussianBlur(field, (0, 0), 1.0)
    return Photo(CAMERA, EdgeField(field, np.zeros_like(field)), 8.0, 0.0)


def test_fit_is_best_at_the_true_step():
    edges = scan_edges(*crosses())
    turn = np.array([0.02, -0.025, 0.01])
    maps = patch_maps(photo_of(edges, exp_so3(turn)), edges, PRIOR, 20, np.random.default_rng(0))
    true = np.concatenate([turn, np.zeros(3)])
    steps = np.vstack(
        [true, np.zeros(6), np.random.default_rng(1).normal(0, 0.02, (200, 6)) * np.repeat([1, 0], 3)]
    )
    fit = maps.fit(steps)
    assert np.argmax(fit) == 0
    assert fit[0] > 2 * fit[1]


def test_distance_of_poses_is_in_pixels():
    edges = scan_edges(*crosses())
    photo = photo_of(edges, np.eye(3))
    maps = patch_maps(photo, edges, PRIOR, 4, np.random.default_rng(0))
    aside = np.array([[0, 0, 0, 0.05, 0, 0]])
    assert maps.apart(aside, np.zeros(6))[0] == pytest.approx(3.0, rel=0.02)
    sideways = PosePrior(np.eye(3), np.zeros(3), np.diag([1e-12, 1e-12, 1e-12, 0.05**2, 0.05**2, 1e-12]))
    assert shift_sigma(photo, edges, sideways) == pytest.approx(3.0, rel=0.02)


def test_pattern_fits_one_period_off_nearly_as_well():
    edges = scan_edges(*crosses(spacing=24))
    maps = patch_maps(photo_of(edges, np.eye(3)), edges, PRIOR, 30, np.random.default_rng(0))
    period = np.array([0, 0, 0, 24 / 300 * 5, 0, 0])
    here, neighbour, between = maps.fit(np.array([0 * period, period, period / 2]))
    assert maps.apart(period[None], np.zeros(6))[0] > APART
    assert neighbour > 0.7 * here
    assert between < 0.6 * here
