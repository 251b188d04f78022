"""Panoramas: faces across the seam are used like others, on both sides of it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from fresco.core.cameras import EquirectangularCamera
from fresco.core.photos import View
from fresco.core.settings import TextureSettings
from fresco.core.texture import select_views, write_obj
from fresco.core.texture.models.colours import colour_vertices
from fresco.core.texture.models.render import render_view
from fresco.core.texture.quality import psnr
from fresco.core.texture.views.images import to_bytes, to_srgb
from painted_scenes import box_mesh, look_at, paint, photograph

ROOM = box_mesh((-3.0, -1.6, -2.5), (3.0, 1.4, 2.5), 18)
ROOM = (ROOM[0], ROOM[1][:, ::-1].copy())  # seen from inside
CAMERA = EquirectangularCamera(800, 400)


@pytest.fixture(scope="module")
def view():
    rotation, translation = look_at((0.4, 0.1, -0.3), (2.0, 0.1, 1.0))
    return View(CAMERA, rotation, translation, photograph(CAMERA, rotation, translation, ROOM), "panorama")


@pytest.fixture(scope="module")
def selection(view):
    return select_views(*ROOM, [view], TextureSettings(max_angle=89.0))


def at_seam(selection):
    u = selection.uv[..., 0]
    return (selection.view >= 0) & ((u.min(axis=1) < -0.5) | (u.max(axis=1) > CAMERA.width - 0.5))


def test_faces_across_the_seam_are_seen_and_not_smeared(view, selection):
    seam = at_seam(selection)
    assert seam.sum() > 30
    assert np.mean(selection.view >= 0) > 0.99  # all but those around the poles
    assert np.ptp(selection.uv[..., 0], axis=1)[selection.view >= 0].max() < 0.5 * CAMERA.width
    centre = selection.uv[seam].mean(axis=1)
    assert CAMERA.in_frame(centre).all()
    # On the faces' scale the texture beyond the frame is as fine as within it.
    assert np.isfinite(selection.texel_size[seam]).all()
    assert selection.texel_size[seam].max() < 5 * np.nanmedian(selection.texel_size)


def test_the_seam_does_not_show_in_a_rendering(view, selection):
    rendering = render_view(CAMERA, view.rotation, view.translation, *ROOM, selection, [view])
    near_seam = np.zeros((400, 800), bool)
    near_seam[100:300, :20] = near_seam[100:300, -20:] = True
    covered = rendering.covered & near_seam
    assert covered.sum() > 0.99 * near_seam.sum()
    elsewhere = rendering.covered & ~near_seam
    elsewhere[:100] = elsewhere[300:] = False
    seam_db = psnr(rendering.image, view.image, covered)
    assert seam_db > 38
    assert seam_db > psnr(rendering.image, view.image, elsewhere) - 3


def test_vertices_at_the_seam_show_the_paint(view, selection):
    found = colour_vertices(*ROOM, selection, [view])
    seam = np.unique(ROOM[1][at_seam(selection)])
    difference = found.rgb[seam].astype(int) - to_bytes(to_srgb(paint(ROOM[0][seam])))
    assert np.abs(difference).mean() < 6


def test_a_mask_is_obeyed_on_both_sides_of_the_seam(view, selection):
    mask = np.ones((400, 800), bool)
    mask[:, -27:] = False
    masked = View(CAMERA, view.rotation, view.translation, view.image, "panorama", mask)
    u = select_views(*ROOM, [masked], TextureSettings(max_angle=89.0))
    seen = u.view >= 0
    assert seen.any()
    assert (np.mod(u.uv[seen][..., 0] + 0.5, 800) < 773.5).all()


def test_obj_viewers_find_the_other_side_by_repeating(tmp_path, view, selection):
    photo = tmp_path / "panorama.png"
    cv2.imwrite(str(photo), view.image[..., ::-1])
    file_view = View(CAMERA, view.rotation, view.translation, photo, "panorama")
    write_obj(tmp_path / "room.obj", *ROOM, selection, [file_view])
    lines = (tmp_path / "room.obj").read_text().splitlines()
    uv = np.array([line.split()[1:] for line in lines if line.startswith("vt ")], float)
    corners = [[p.split("/") for p in line.split()[1:]] for line in lines if line.startswith("f ")]
    spans = [
        np.ptp([uv[int(p[1]) - 1, 0] for p in face]) for face in corners if all(len(p) > 1 for p in face)
    ]
    assert max(spans) < 0.5
    assert uv[:, 0].min() < 0 and uv[:, 0].max() > 1
