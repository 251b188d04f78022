import cv2
import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.errors import RegionError
from fresco.core.geometry.outlines import loop_area
from fresco.core.geometry.rigid import exp_so3
from fresco.core.pose import estimate_pose
from fresco.core.regions import ImageRegion
from fresco.core.regions.surface.cloud_index import index_cloud
from fresco.core.regions.surface.cloud_region import cloud_region
from fresco.core.regions.surface.wand import grow_surface, region_faces

FAR = np.array([3_500_000.0, 5_000_000.0, 250.0])
TURN = exp_so3([0.4, -0.3, 0.8])
SHAPE = np.array([[0, 0], [2, 0], [2, 1], [1.2, 1], [1.2, 1.6], [0, 1.4]])


def inside(polygon, points):
    """Whether points (N,2) lie in a polygon (n,2)."""
    path = (polygon * 1e4).astype(np.int32)
    return np.array([cv2.pointPolygonTest(path, tuple(p), False) > 0 for p in (points * 1e4).tolist()])


def cloud(polygon, hole=None, spacing=0.02, noise=0.002, seed=0, uneven=False):
    """Points (N,3) scattered in a polygon of the plane z = 0, with noise across it."""
    rng = np.random.default_rng(seed)
    size = np.ptp(polygon, axis=0)
    flat = polygon.min(axis=0) + rng.random((int(size.prod() / spacing**2), 2)) * size
    if uneven:
        flat = flat[rng.random(len(flat)) < 0.2 + 0.8 * (flat[:, 0] - flat[:, 0].min()) / size[0]]
    flat = flat[inside(polygon, flat)]
    if hole is not None:
        flat = flat[~inside(hole, flat)]
    return np.column_stack([flat, rng.normal(0, noise, len(flat))])


def area_of(region):
    edges = region.vertices[region.faces]
    return 0.5 * np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1).sum()


def test_the_outline_of_a_known_shape_is_found_without_bias():
    region = cloud_region(cloud(SHAPE) @ TURN.T + FAR, "panel")
    assert area_of(region) == pytest.approx(abs(loop_area([SHAPE])), rel=0.01)
    assert len(region.loops) == 1  # no hole where chance left a gap
    local = (region.vertices - FAR) @ TURN
    assert np.abs(local[:, 2]).max() < 0.002  # noise across the surface is gone
    assert np.allclose(local[:, :2].min(axis=0), SHAPE.min(axis=0), atol=0.02)


def test_a_window_stays_a_hole():
    window = np.array([[0.4, 0.4], [0.9, 0.4], [0.9, 0.9], [0.4, 0.9]])
    region = cloud_region(cloud(SHAPE, window))
    loops = sorted(region.loops, key=lambda loop: np.ptp(loop, axis=0).max())
    assert area_of(region) == pytest.approx(abs(loop_area([SHAPE])) - 0.25, rel=0.015)
    assert np.allclose(np.ptp(loops[-2], axis=0)[:2], 0.5, atol=0.06)


def test_density_may_vary_fivefold():
    region = cloud_region(cloud(SHAPE, spacing=0.012, uneven=True))
    assert area_of(region) == pytest.approx(abs(loop_area([SHAPE])), rel=0.02)


def test_a_vault_is_laid_out_on_its_curve():
    flat = cloud(np.array([[-1, 0], [1, 0], [1, 2], [-1, 2]]) * 1.0)
    bent = np.stack([flat[:, 0], flat[:, 1], flat[:, 2] + 0.2 * flat[:, 0] ** 2], axis=1)
    region = cloud_region(bent)
    assert np.abs(region.vertices[:, 2] - 0.2 * region.vertices[:, 0] ** 2).max() < 0.008


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((5, 3)), "fewer than 20 points"),
        (np.full((40, 3), np.nan), "not numbers"),
        (np.linspace(0, 1, 40)[:, None] * [1, 2, 3], "in a row"),
        (np.tile(np.eye(3), (10, 1)), "too few different points"),
        (np.concatenate([cloud(SHAPE) + 10.0 * k for k in range(3)]), "scattered in pieces"),
    ],
)
def test_points_without_an_outline_are_refused(points, message):
    with pytest.raises(RegionError, match=message):
        cloud_region(points, "panel")


def corner(spacing=0.03):
    """Cloud of two walls at right angles, 3 x 2 m each, and which points belong to the first."""
    square = np.array([[0, 0], [3, 0], [3, 2], [0, 2]]) * 1.0
    first, second = cloud(square, spacing=spacing), cloud(square, spacing=spacing, seed=1)
    points = np.concatenate([first, second[:, [2, 1, 0]]])
    return points, np.arange(len(points)) < len(first)


def test_the_wand_grows_over_one_wall_of_a_cloud():
    points, first = corner()
    index = index_cloud(points + FAR)
    seed = int(np.argmin(np.linalg.norm(points - [1.5, 1, 0], axis=1)))
    found = np.zeros(len(points), dtype=bool)
    found[region_faces(index, seed, grow_surface(index, seed).level())] = True
    assert np.count_nonzero(found & first) / np.count_nonzero(found | first) > 0.95


def test_bad_clouds_are_refused_with_a_sentence():
    with pytest.raises(RegionError, match="fewer than"):
        index_cloud(np.zeros((3, 3)))
    with pytest.raises(RegionError, match="not numbers"):
        index_cloud(np.full((50, 3), np.nan))
    with pytest.raises(RegionError, match="every point"):
        index_cloud(np.random.default_rng(0).random((50, 3)), np.zeros((3, 3), dtype=np.uint8))


def test_a_pose_follows_from_regions_of_a_cloud():
    camera = PerspectiveCamera(1500, 1000, [[1200, 0, 749.5], [0, 1200, 499.5], [0, 0, 1]])
    turn, shift = exp_so3([0.1, 0.25, -0.05]), np.array([-1.0, -0.8, 5.0])
    frames = [(np.eye(3), np.zeros(3)), (exp_so3([0, -1.0, 0]), np.array([2.6, 0.1, 0.2]))]
    images, surfaces = [], []
    for number, (own, move) in enumerate(frames):
        corners = np.column_stack([SHAPE, np.zeros(len(SHAPE))]) @ own.T + move
        pixels = camera.project(corners @ turn.T + shift)
        images.append(ImageRegion.from_polygon(pixels))
        surfaces.append(cloud_region(cloud(SHAPE, spacing=0.015, seed=number) @ own.T + move))
    pose = estimate_pose(camera, images, surfaces)
    error = np.degrees(np.arccos(np.clip((np.trace(pose.rotation @ turn.T) - 1) / 2, -1, 1)))
    centre = -turn.T @ shift
    assert error < 0.2
    assert np.linalg.norm(-pose.rotation.T @ pose.translation - centre) < 0.02
