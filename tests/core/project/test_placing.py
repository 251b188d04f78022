"""Sparse points laid onto the scan: scale, turn and shift come back, or a sentence says why they do not."""

from dataclasses import replace

import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.cameras.exchange import PosedCamera, Reconstruction
from fresco.core.errors import PoseNotFound
from fresco.core.geometry.rigid import exp_so3, rotation_angle
from fresco.core.project.stages.placing import Placed, place_by_matrix, place_on_surface
from fresco.core.scans.scan import Scan

FAR = np.array([5_012_300.0, 423_400.0, 80.0])
CAMERA = PerspectiveCamera(480, 360, [[390.0, 0, 239.5], [0, 390, 179.5], [0, 0, 1]])
ROTATION, CENTRE = exp_so3([1.2, 0.3, -0.4]), np.array([2.5, 2.0, 1.5])
PANELS = (
    ((0, 0, 0), (4, 0, 0), (0, 0, 3)),
    ((0, 0, 0), (0, 3, 0), (0, 0, 3)),
    ((0, 0, 0), (4, 0, 0), (0, 3, 0)),
    ((4, 0, 0), (0, 3, 0), (0, 0, 3)),
    ((1, 0.4, 0), (1.5, 0, 0), (0, 0, 1)),
    ((1, 0, 1), (1.5, 0, 0), (0, 0.4, 0)),
)
"""A niche 4 m wide with floor and a chest; corner and two sides (m) of each panel."""


def niche(step=0.05, noise=0.002, panels=PANELS):
    """Scan with noisy vertices, far from the origin of its world."""
    rng, vertices, faces, start = np.random.default_rng(1), [], [], 0
    for corner, along, up in np.array(panels, dtype=float):
        n, m = (int(np.linalg.norm(side) / step) + 1 for side in (along, up))
        s, t = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, m)))
        points = corner + s[:, None] * along + t[:, None] * up
        vertices.append(points + rng.normal(0, noise, points.shape))
        first = (np.arange(m - 1)[:, None] * n + np.arange(n - 1)).ravel() + start
        faces += [
            np.stack([first, first + 1, first + n + 1], 1),
            np.stack([first, first + n + 1, first + n], 1),
        ]
        start += len(points)
    of_mesh = np.concatenate(faces).astype(np.int64)
    return Scan(np.concatenate(vertices), of_mesh, FAR, np.arange(len(of_mesh)), len(of_mesh))


def reconstruction(strays=0.2, seed=2, panels=PANELS):
    """A camera and points of the surface as another program has them on the scan, some of them beside it."""
    rng = np.random.default_rng(seed)
    panel = np.array(panels, dtype=float)[rng.integers(0, len(panels), 800)]
    shares = rng.uniform(0.02, 0.98, (800, 2))
    points = panel[:, 0] + np.einsum("ns,nsk->nk", shares, panel[:, 1:]) + rng.normal(0, 0.003, (800, 3))
    stray = rng.random(800) < strays
    points[stray] += rng.normal(0, 0.4, (int(stray.sum()), 3))
    camera = PosedCamera("a.jpg", CAMERA, ROTATION, -ROTATION @ CENTRE)
    return Reconstruction((camera,), points, np.zeros((800, 3), np.uint8))


def placed(degrees, metres, scale, scan=None, seed=0, **made):
    """Where the camera comes to lie when its world is off by a turn, a shift and a scale."""
    rng = np.random.default_rng(seed)
    turn, move = rng.normal(size=3), rng.normal(size=3)
    turn = exp_so3(np.radians(degrees) * turn / np.linalg.norm(turn))
    off = reconstruction(**made).transformed(scale, turn, metres * move / np.linalg.norm(move))
    start = place_by_matrix(1.0, np.eye(3), FAR, scan or niche())
    found = place_on_surface(off, scan or niche(), start)
    camera = off.cameras[0]
    return found, scale, *found.pose(camera.rotation, camera.translation)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("off", [(0.0, 0.0, 1.0), (1.0, 0.03, 1.01), (2.0, 0.05, 0.98)])
def test_sparse_points_bring_the_cameras_onto_the_scan(off, seed):
    found, scale, rotation, translation = placed(*off, seed=seed)
    assert found.scale * scale == pytest.approx(1.0, abs=1e-3)
    assert np.degrees(rotation_angle(rotation @ ROTATION.T)) < 0.05
    assert np.linalg.norm(-rotation.T @ translation - CENTRE) < 0.003
    assert "of its points lie on the scan" in found.note


def test_coarse_scan_does_as_well():
    _, _, rotation, translation = placed(1.0, 0.03, 1.01, scan=niche(step=0.25))
    assert np.linalg.norm(-rotation.T @ translation - CENTRE) < 0.003
    assert np.degrees(rotation_angle(rotation @ ROTATION.T)) < 0.05


@pytest.mark.parametrize("off", [(0.0, 40.0, 1.0), (0.0, 0.0, 100.0), (60.0, 1.0, 1.0), (0.0, 0.8, 1.4)])
def test_a_start_out_of_reach_is_refused(off):
    with pytest.raises(PoseNotFound, match=r"poses or by points"):
        placed(*off)


def test_cloud_does_as_well():
    cloud = replace(niche(step=0.03), faces=np.zeros((0, 3), np.int64))
    _, _, rotation, translation = placed(1.0, 0.03, 1.01, scan=cloud)
    assert np.linalg.norm(-rotation.T @ translation - CENTRE) < 0.003


@pytest.mark.parametrize("panels", [PANELS[:1], PANELS[:2]], ids=["wall", "corner"])
@pytest.mark.parametrize("noise", [0.0, 0.002, 0.006])
def test_what_slides_along_the_scan_is_refused(panels, noise):
    """However noisy a plain wall is, its noise is no relief that holds the points."""
    with pytest.raises(PoseNotFound, match="leaves open"):
        placed(0.5, 0.02, 1.0, scan=niche(panels=panels, noise=noise), panels=panels)


def test_too_few_points_are_refused():
    few = reconstruction()
    few = Reconstruction(few.cameras, few.points[:40], few.colours[:40])
    with pytest.raises(PoseNotFound, match="40 points"):
        place_on_surface(few, niche(), Placed(1.0, np.eye(3), np.zeros(3), ""))
