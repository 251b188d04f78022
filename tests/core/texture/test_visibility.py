from __future__ import annotations

import numpy as np
import pytest
from fresco.core.cameras import CatadioptricCamera, EquirectangularCamera, FisheyeCamera, PerspectiveCamera
from fresco.core.photos import View
from fresco.core.settings import TextureSettings
from fresco.core.texture.surface import Surface, used_vertices
from fresco.core.texture.views.frustum import Frustum, blocks_in_view
from fresco.core.texture.views.visibility import visible_faces
from painted_scenes import box_mesh, grid_mesh, join, look_at

CAMERAS = {
    "perspective": PerspectiveCamera(
        600, 400, [[400, 0, 310], [0, 405, 190], [0, 0, 1]], (-0.2, 0.06, 1e-3, 0)
    ),
    "tele": PerspectiveCamera(600, 400, [[2500, 0, 310], [0, 2500, 190], [0, 0, 1]]),
    "fisheye": FisheyeCamera(600, 600, [[190, 0, 300], [0, 190, 300], [0, 0, 1]], (0.02, -0.01, 0, 0)),
    "catadioptric": CatadioptricCamera(600, 600, [[260, 0, 300], [0, 260, 300], [0, 0, 1]], 0.9),
    "panorama": EquirectangularCamera(1000, 500),
}


def rough_room(cells=60):
    """A wall, two pillars and a box in front, roughened like a scan."""
    room = join(
        grid_mesh(cells, cells * 3 // 4, 8.0, 6.0),
        box_mesh((-2.0, -3.0, -1.6), (-1.4, 3.0, -1.0), 14),
        box_mesh((1.0, -3.0, -2.2), (1.5, 3.0, -1.7), 14),
        box_mesh((-0.6, 1.0, -1.2), (0.5, 2.0, -0.4), 8),
    )
    noise = np.random.default_rng(1).normal(scale=0.003, size=room[0].shape)
    return room[0] + noise, room[1]


def view_of(camera, centre=(0.3, -0.4, -4.5), target=(0.0, 0.2, 0.0)):
    rotation, translation = look_at(centre, target)
    return View(camera, rotation, translation, np.zeros((camera.height, camera.width, 3), np.uint8))


def exhaustive(surface, view, samples=60):
    """Share of random points on each face that the view sees, by one ray each; NaN for faces out of frame."""
    corners = surface.vertices[surface.faces]
    weights = np.random.default_rng(3).dirichlet((1, 1, 1), samples)
    points = np.einsum("sk,fkc->fsc", weights, corners)
    hidden = surface.caster.occluded(view.centre - surface.origin, points.reshape(-1, 3)).reshape(-1, samples)
    everywhere = np.concatenate([corners + surface.origin], axis=1).reshape(-1, 3)
    pixels = view.camera.project(everywhere @ view.rotation.T + view.translation)
    framed = view.camera.in_frame(pixels).reshape(-1, 3).all(axis=1)
    towards = view.centre - surface.origin - surface.centroid
    cosine = np.einsum("fk,fk->f", towards, surface.normal) / np.linalg.norm(towards, axis=1)
    return np.where(framed & (cosine > np.cos(np.radians(85))), 1 - hidden.mean(axis=1), np.nan)


# Poles of a scaffold, thinner than the faces behind them: they hide the scan, and are not there afterwards.
POLES = [
    box_mesh((x - w / 2, -3.0, z - w / 2), (x + w / 2, 3.0, z + w / 2), 1)
    for x, z, w in ((-0.9, -1.5, 0.05), (0.2, -2.0, 0.08), (1.9, -1.0, 0.06), (0.8, -2.5, 0.1))
]


@pytest.mark.parametrize("occluders", [[], POLES], ids=["scan alone", "behind a scaffold"])
@pytest.mark.parametrize("name", ["perspective", "fisheye", "catadioptric"])
def test_precision_and_recall_against_exhaustive_rays(name, occluders):
    surface = Surface.from_mesh(*rough_room(), occluders)
    hits = found = wrong = missed = 0
    for x in np.linspace(-2, 2, 5):
        view = view_of(CAMERAS[name], (x, -0.4, -4.5))
        share = exhaustive(surface, view)
        seen = visible_faces(surface, view, TextureSettings(visible_share=0.9))
        is_seen = np.zeros(surface.face_count, bool)
        is_seen[seen.face] = True
        found += is_seen.sum()
        # Asked for 90 %; what exhaustive rays put close to that may fall on either side.
        wrong += (is_seen & ~(share >= 0.8)).sum()
        hits += (share >= 0.97).sum()
        missed += ((share >= 0.97) & ~is_seen).sum()
    assert found > 5000
    assert 1 - wrong / found >= 0.999
    assert 1 - missed / hits >= 0.999


@pytest.mark.parametrize("name", list(CAMERAS))
def test_culling_by_blocks_loses_no_face(name):
    surface = Surface.from_mesh(*rough_room(90))
    view = view_of(CAMERAS[name])
    pixels = view.camera.project((surface.vertices + surface.origin) @ view.rotation.T + view.translation)
    framed = view.camera.in_frame(pixels)[surface.faces].all(axis=1)
    towards = view.centre - surface.origin - surface.centroid
    framed &= np.einsum("fk,fk->f", towards, surface.normal) > 0
    blocks = blocks_in_view(surface.blocks, view, surface.origin, np.radians(90.0))
    assert np.isin(np.unique(np.flatnonzero(framed) // surface.blocks.size), blocks).all()


@pytest.mark.parametrize("name", list(CAMERAS))
def test_a_frustum_holds_every_pixel_of_its_camera(name):
    camera = CAMERAS[name]
    pixels = np.random.default_rng(0).uniform(
        (-0.5, -0.5), (camera.width - 0.5, camera.height - 0.5), (4000, 2)
    )
    rays = camera.unproject(pixels)
    rays = rays[np.isfinite(rays).all(axis=1)]
    assert Frustum.of_camera(camera).meets(7.0 * rays, np.zeros(len(rays))).all()


@pytest.mark.parametrize("name", list(CAMERAS))
def test_texel_size_is_that_of_the_cameras_jacobian(name):
    surface = Surface.from_mesh(*rough_room(160))
    view = view_of(CAMERAS[name])
    seen = visible_faces(surface, view, TextureSettings())
    centre = (surface.vertices[surface.faces[seen.face]].mean(axis=1) + surface.origin) @ view.rotation.T
    jacobian = view.camera.project_with_jacobian(centre + view.translation)[1] @ view.rotation
    normal = surface.normal[seen.face].astype(float)
    helper = np.where(np.abs(normal[:, 2:]) < 0.8, [[0.0, 0, 1]], [[1.0, 0, 0]])
    right = np.cross(helper, normal)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    on_surface = np.stack([right, np.cross(normal, right)], axis=2)
    density = np.abs(np.linalg.det(jacobian @ on_surface))
    ratio = seen.texel * np.sqrt(density)
    wall = seen.distance > 3.5
    assert wall.sum() > 100
    assert np.abs(np.median(ratio[wall]) - 1) < 0.002
    assert np.percentile(np.abs(ratio[wall] - 1), 95) < 0.05


def test_faces_across_a_panoramas_seam_are_not_smeared():
    surface = Surface.from_mesh(*rough_room())
    view = view_of(CAMERAS["panorama"], (0.3, -0.4, -4.5), (0.0, 0.2, -9.0))  # the seam crosses the wall
    seen = visible_faces(surface, view, TextureSettings())
    assert len(seen) > 500
    assert np.ptp(seen.uv[..., 0], axis=1).max() < 100


def test_faces_without_area_and_smaller_than_a_pixel_do_no_harm():
    wall = grid_mesh(400, 300, 0.4, 0.3)
    faces = np.concatenate([wall[1], [[0, 0, 1], [5, 6, 6]]])
    seen = visible_faces(
        Surface.from_mesh(wall[0], faces), view_of(CAMERAS["perspective"]), TextureSettings()
    )
    assert len(seen) > 0.9 * len(wall[1])
    assert np.isfinite(seen.texel).all()


def test_faces_are_counted_by_the_vertices_they_use():
    faces = np.array([[7, 2, 9], [2, 7, 4]], dtype=np.int32)
    vertex, local = used_vertices(faces, 12)
    np.testing.assert_array_equal(vertex, [2, 4, 7, 9])
    np.testing.assert_array_equal(vertex[local], faces)
    nothing, none = used_vertices(faces[:0], 12)
    assert nothing.shape == (0,)
    assert none.shape == (0, 3)
