"""Scans and photos that are not as they should be."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from fresco.core.cameras import EquirectangularCamera
from fresco.core.errors import PhotoError, RegionError
from fresco.core.geometry.meshes import face_normals
from fresco.core.photos import View
from fresco.core.settings import TextureSettings
from fresco.core.texture import select_views, split_large_faces
from fresco.core.texture.surface import Surface
from fresco.core.texture.views.memory import photo_bytes
from fresco.core.texture.views.survey import survey_photo
from painted_scenes import box_mesh, grid_mesh, join, look_at, wall_views

WALL = grid_mesh(24, 18)
PLACES = [(-1.2, 0.3, -4.0), (1.2, -0.2, -4.2), (0.0, 0.1, -2.6)]


@pytest.fixture(scope="module")
def views():
    return wall_views(WALL, PLACES)


def saved(view, path, image):
    path.write_bytes(cv2.imencode(path.suffix, image)[1].tobytes())
    return replace(view, image=path, name=path.name)


def test_self_intersecting_meshes_are_textured_where_they_are_seen():
    # A box half sunk into the wall, and another through both.
    mesh = join(
        grid_mesh(24, 18),
        box_mesh((-0.6, -0.5, -0.3), (0.4, 0.4, 0.3)),
        box_mesh((0, 0, -0.5), (0.9, 0.2, 0.1)),
    )
    views = wall_views(mesh, PLACES)
    selection = select_views(*mesh, views)
    middle = mesh[0][mesh[1]].mean(axis=1)
    sunk = np.all((middle > (-0.55, -0.45, -0.25)) & (middle < (0.35, 0.35, 0.25)), axis=1)
    assert sunk.any()
    assert np.all(selection.view[sunk] == -1)  # inside the first box
    free = (middle[:, 2] == 0) & (np.abs(middle[:, 0]) < 1.2) & (middle[:, 1] < -0.7) & (middle[:, 1] > -1.2)
    assert np.all(selection.view[free] >= 0)


def test_faces_far_below_a_pixel_get_texture():
    wall = grid_mesh(300, 220, 0.3, 0.22)  # a millimetre each, seen with 8 mm per pixel
    views = wall_views(wall, [(0.1, 0.0, -2.5), (-0.1, 0.05, -2.4)])
    selection = select_views(*wall, views)
    assert np.mean(selection.view >= 0) > 0.99
    assert np.isfinite(selection.uv).all()
    assert np.nanmedian(selection.texel_size) == pytest.approx(2.5 / 300, rel=0.1)


def test_photos_of_one_side_leave_the_other_without_texture_and_say_how_much():
    box = box_mesh((-1, -1, -1), (1, 1, 1), 8)
    views = wall_views(box, [(0.2, 0.1, -4.0), (-0.3, 0.2, -4.0), (0.0, -0.2, -4.2)])
    selection = select_views(*box, views)
    normal, area = face_normals(*box)
    front = normal[:, 2] < -0.9
    assert np.all(selection.view[front] >= 0)
    assert np.all(selection.view[normal[:, 2] > 0.9] == -1)
    assert area[selection.view >= 0].sum() == pytest.approx(area[front].sum(), rel=0.2)


def test_when_no_photo_sees_anything_all_stays_without():
    away = wall_views(WALL, [(0, 0, -3.0), (0.5, 0, -3.0)], target=(0, 0, -9.0))
    selection = select_views(*WALL, away)
    assert np.all(selection.view == -1)
    assert np.all(selection.view_count == 0)
    assert np.isnan(selection.texel_size).all()
    np.testing.assert_array_equal(selection.gain, 1)


@pytest.mark.parametrize("kind", ["16 bits", "grey", "opaque alpha"])
def test_photos_of_other_kinds_give_the_same_texture(views, tmp_path, kind):
    image = views[2].image[..., ::-1]
    if kind == "16 bits":
        odd = saved(views[2], tmp_path / "deep.tif", image.astype(np.uint16) * 257)
    elif kind == "grey":
        odd = saved(views[2], tmp_path / "grey.png", cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
    else:
        odd = saved(views[2], tmp_path / "alpha.png", cv2.cvtColor(image, cv2.COLOR_BGR2BGRA))
    settings = TextureSettings(reject_foreign=False, smoothness=0)
    plain = select_views(*WALL, [views[2]], settings)
    found = select_views(*WALL, [odd], settings)
    np.testing.assert_array_equal(found.view, plain.view)
    np.testing.assert_array_equal(found.uv, plain.uv)


def test_transparent_parts_of_a_photo_are_not_used(views, tmp_path):
    alpha = np.full((240, 320, 1), 255, np.uint8)
    alpha[:, :160] = 0
    cut_out = saved(
        views[2], tmp_path / "cut.png", np.concatenate([views[2].image[..., ::-1], alpha], axis=2)
    )
    selection = select_views(*WALL, [cut_out])
    seen = selection.view >= 0
    assert seen.any()
    assert selection.uv[seen][..., 0].min() > 158
    mask = np.ones((240, 320), bool)
    mask[120:] = False
    both = select_views(*WALL, [replace(cut_out, mask=mask)])
    seen = both.view >= 0
    assert seen.any()
    assert selection.uv[seen][..., 0].min() > 158 and both.uv[seen][..., 1].max() < 121


def test_a_mask_may_be_a_file(views, tmp_path):
    mask = np.zeros((240, 320), np.uint8)
    mask[60:200, 80:300] = 255
    path = tmp_path / "mask.png"
    cv2.imwrite(str(path), mask)
    as_array = [replace(views[0], mask=mask > 0), *views[1:]]
    as_file = [replace(views[0], mask=path), *views[1:]]
    np.testing.assert_array_equal(select_views(*WALL, as_file).view, select_views(*WALL, as_array).view)
    cv2.imwrite(str(path), mask[:100])
    with pytest.raises(PhotoError, match="the mask is 320 x 100 pixels, the photo 320 x 240"):
        select_views(*WALL, as_file)
    cv2.imwrite(str(path), np.zeros_like(mask))
    with pytest.raises(RegionError, match="the mask is empty"):
        select_views(*WALL, as_file)
    path.unlink()
    with pytest.raises(PhotoError, match=r"mask\.png: no such mask"):
        select_views(*WALL, as_file)


def test_a_panorama_of_100_megapixels_is_read_at_a_fraction(tmp_path):
    camera = EquirectangularCamera(14142, 7071)
    random = np.random.default_rng(0)
    small = random.integers(0, 255, (221, 442, 3)).astype(np.uint8)
    path = tmp_path / "panorama.jpg"
    cv2.imwrite(str(path), cv2.resize(small, (14142, 7071), interpolation=cv2.INTER_LINEAR))
    room = box_mesh((-3, -2, -2), (3, 1.5, 2), 40)
    room = room[0], room[1][:, ::-1].copy()
    rotation, translation = look_at((0.3, 0.1, 0.2), (2.0, 0.1, 1.0))
    view = View(camera, rotation, translation, path)
    found = survey_photo(Surface.from_mesh(*room), view, TextureSettings())
    assert found is not None and found.scale == 0.25
    assert len(found.seen) > 0.99 * len(room[1])
    assert photo_bytes(view, TextureSettings()) < 200e6  # instead of 300 MB for its pixels alone
    mesh = split_large_faces(*room, [view])
    assert len(room[1]) < len(mesh.faces) < 60 * len(room[1])
