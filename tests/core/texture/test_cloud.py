from __future__ import annotations

import numpy as np
import pytest
from fresco.core.cameras import EquirectangularCamera, PerspectiveCamera
from fresco.core.errors import TextureError
from fresco.core.geometry.rays import RayCaster
from fresco.core.photos import View
from fresco.core.texture.views.cloud import visible_points
from fresco.core.texture.views.splats import measure_splats, tangents
from painted_scenes import box_mesh, grid_mesh, join, look_at

ROOM = join(
    grid_mesh(8, 6, 8.0, 6.0),
    box_mesh((-2.0, -1.0, -1.8), (-1.2, 3.0, -1.0)),
    box_mesh((0.6, 0.5, -2.5), (1.6, 3.0, -1.4)),
)


def sampled(count, seed=0):
    vertices, faces = ROOM
    random = np.random.default_rng(seed)
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    face = random.choice(len(faces), count, p=area / area.sum())
    points = np.einsum("nk,nkc->nc", random.dirichlet((1, 1, 1), count), corners[face])
    return points, normal[face] / area[face, None]


def perspective(centre=(0.7, -0.8, -6.0)):
    rotation, translation = look_at(centre, (0, 0, -1))
    camera = PerspectiveCamera(1200, 900, [[900, 0, 600], [0, 900, 450], [0, 0, 1]])
    return View(camera, rotation, translation, np.zeros((900, 1200, 3), np.uint8))


def panorama(centre=(0.2, 0.0, -4.0)):
    rotation, translation = look_at(centre, (0, 0, -1))
    return View(EquirectangularCamera(1600, 800), rotation, translation, np.zeros((800, 1600, 3), np.uint8))


def truth(points, normals, view):
    inside = view.camera.in_frame(view.camera.project(points @ view.rotation.T + view.translation))
    facing = np.einsum("nk,nk->n", view.centre - points, normals) > 0
    return inside & facing & ~RayCaster(*ROOM).occluded(view.centre, points)


@pytest.mark.parametrize("view", [perspective(), panorama()], ids=["perspective", "panorama"])
def test_depth_buffer_agrees_with_rays(view):
    points, normals = sampled(120_000)
    expected = truth(points, normals, view)
    found = visible_points(points, normals, view)
    assert (found & expected).sum() / found.sum() >= 0.99
    assert (found & expected).sum() / expected.sum() >= 0.99


def test_an_uneven_cloud_agrees_with_rays():
    """Four times as dense on one side as on the other."""
    points, normals = sampled(160_000, seed=3)
    share = np.clip((points[:, 0] + 4) / 8, 0.25, 1)
    kept = np.random.default_rng(4).random(len(points)) < share
    points, normals = points[kept], normals[kept]
    view = perspective((1.9, 0.2, -3.5))
    expected, found = truth(points, normals, view), visible_points(points, normals, view)
    assert (found & expected).sum() / found.sum() >= 0.99
    assert (found & expected).sum() / expected.sum() >= 0.99


def test_a_splat_does_not_overhang_the_rim_of_a_sheet():
    """A sheet before a wall, and a point of the wall just beside what the sheet hides."""
    x, y = np.meshgrid(np.arange(-20, 21) * 0.02, np.arange(-20, 21) * 0.02)
    sheet = np.stack([x.ravel(), y.ravel(), np.full(x.size, -1.0)], axis=1)
    rim = 0.4 / 5 * 6  # where rays from (0, 0, -6) past the sheet's last points meet the wall at z = 0
    wall = np.array([[rim - 0.02, 0.0, 0.0], [rim + 0.025, 0.0, 0.0], [0.0, rim - 0.02, 0.0]])
    points = np.concatenate([sheet, wall])
    normals = np.tile([0.0, 0.0, -1.0], (len(points), 1))
    assert visible_points(points, normals, perspective((0, 0, -6)))[-3:].tolist() == [False, True, False]


def test_bend_is_the_curvature_and_doubles_do_not_matter():
    """Points on a cylinder of 0.5 m about the y axis, every one of them twice."""
    angle, y = np.meshgrid(np.arange(-1.2, 1.2, 0.04), np.arange(-1, 1, 0.02))
    normals = np.stack([np.sin(angle).ravel(), 0 * y.ravel(), -np.cos(angle).ravel()], axis=1)
    points = 0.5 * normals + np.stack([0 * y.ravel(), y.ravel(), 0 * y.ravel()], axis=1)
    inner = (np.abs(angle.ravel()) < 1) & (np.abs(y.ravel()) < 0.9)
    splats = measure_splats(points, normals)
    first, second = tangents(normals)
    for tangent, bend in ((first, splats.bend[:, 0]), (second, splats.bend[:, 2])):
        around = np.where(np.abs(tangent[inner, 1]) < 0.5, 2.0, 0.0)
        np.testing.assert_allclose(bend[inner], around, atol=0.02)
    doubled = measure_splats(np.repeat(points, 2, axis=0), np.repeat(normals, 2, axis=0))
    assert np.median(doubled.reach[::2][inner] / splats.reach[inner]) > 0.8


def test_few_points_see_one_another():
    for count in (1, 2, 3):
        points = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])[:count]
        normals = np.tile([0.0, 0, -1], (count, 1))
        assert visible_points(points, normals, perspective((0, 0, -6))).all()


def test_a_pillar_close_to_the_camera_has_no_holes():
    points, normals = sampled(60_000)
    view = perspective((-1.6, 1.0, -2.35))  # half a metre before the first pillar, which fills the frame
    expected = truth(points, normals, view)
    found = visible_points(points, normals, view)
    behind = found & (points[:, 2] > -1.0)
    assert expected.sum() > 200
    assert (found & expected).sum() / expected.sum() > 0.95
    assert np.count_nonzero(behind & ~expected) < 0.01 * found.sum()


def test_hidden_point_removal_finds_most_of_them_without_normals():
    points, normals = sampled(40_000)
    view = perspective()
    expected = truth(points, normals, view)
    found = visible_points(points, None, view, method="hull", gamma=2.0)
    assert (found & expected).sum() / found.sum() > 0.85
    assert (found & expected).sum() / expected.sum() > 0.6


def test_flipping_keeps_the_near_one_of_two_points_in_line():
    view = perspective((0, 0, -6.0))
    ring = np.stack([np.cos(np.linspace(0, 6, 50)), np.sin(np.linspace(0, 6, 50)), 0 * np.ones(50)], 1)
    points = np.concatenate([[[0, 0, -2.0], [0, 0, 1.0]], ring])
    found = visible_points(points, None, view, method="hull", gamma=1.0)
    assert found[0]
    assert not found[1]


def test_the_depth_buffer_asks_for_normals():
    points, _ = sampled(100)
    with pytest.raises(TextureError, match="needs the points' normals"):
        visible_points(points, None, perspective())


def test_coordinates_far_from_the_origin_do_not_matter():
    points, normals = sampled(20_000)
    shift = np.array([5e6, -3e6, 100.0])
    view = perspective()
    far = View(view.camera, view.rotation, view.translation - view.rotation @ shift, view.image)
    a = visible_points(points, normals, view)
    b = visible_points(points + shift, normals, far)
    assert np.mean(a == b) > 0.999
