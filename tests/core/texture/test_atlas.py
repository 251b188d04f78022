from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.errors import OutputError, TextureError
from fresco.core.settings import AtlasSettings, TextureSettings
from fresco.core.texture import bake_atlas, level_seams, select_views
from fresco.core.texture.colour.correction import ColourCorrection
from fresco.core.texture.models.atlas import fill_margins
from fresco.core.texture.models.charts import pack_shelves
from fresco.core.texture.models.raster import barycentric, rasterise
from fresco.core.texture.models.render import render_view
from fresco.core.texture.quality import image_offset, psnr
from fresco.core.texture.views.images import to_linear
from hypothesis import given
from hypothesis import strategies as st
from painted_scenes import detailed, grid_mesh, paint, wall_views

WALL = grid_mesh(16, 12)


@pytest.fixture(scope="module")
def scene():
    views = wall_views(WALL, [(-1.2, 0.3, -4.0), (1.2, -0.2, -4.2), (0.0, 0.1, -2.6)], [0.7, 1.0, 1.3])
    return views, select_views(*WALL, views, TextureSettings(smoothness=20))


def read(path):
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1]


@pytest.mark.parametrize(("depth", "rings", "levelled"), [(8, 0, False), (16, 4, True)])
def test_every_texel_shows_the_paint_of_its_place(tmp_path, scene, depth, rings, levelled):
    views, selection = scene
    assert len(np.unique(selection.view)) >= 2
    levels = level_seams(*WALL, selection, views) if levelled else None
    settings = AtlasSettings(texel_size=0.012, page_size=512, depth=depth, blend_rings=rings)
    atlas = bake_atlas(tmp_path, "wand ű", *WALL, selection, views, settings, levels)
    pages = [to_linear(read(path)) for path in atlas.paths]
    random = np.random.default_rng(2)
    seen = np.flatnonzero(selection.view >= 0)
    face = random.choice(seen, 4000)
    weights = random.dirichlet((1, 1, 1), 4000)
    points = np.einsum("nk,nkc->nc", weights, WALL[0][WALL[1][face]])
    uv = np.einsum("nk,nkc->nc", weights, atlas.layout.uv[face])
    shown = np.empty((4000, 3))
    for page, image in enumerate(pages):
        on = atlas.layout.page[face] == page
        column, row = uv[on].T.astype(np.float32)
        shown[on] = cv2.remap(image, column[None], row[None], cv2.INTER_LINEAR)[0]
    inner = np.all(np.abs(points[:, :2]) < (1.9, 1.4), axis=1)  # the wall's edge mixes with what is behind
    shown, points = shown[inner], points[inner]
    expected = paint(points)
    ratio = np.median(shown / expected, axis=0)
    assert np.ptp(ratio) < 0.03
    error = shown / ratio - expected
    assert np.sqrt(np.mean(error**2)) < 0.01


@pytest.mark.parametrize("charts", ["photos", "surface"])
def test_the_atlas_shows_what_a_photo_left_out_shows_at_the_same_place(tmp_path, charts):
    """No half texel is lost on the way from photo to page to picture."""
    wall = grid_mesh(64, 48)  # faces small enough for straight UV edges to a few hundredths of a pixel
    places, large = (
        [(-0.5, 0.2, -2.8), (0.5, -0.2, -2.8), (0.1, 0.2, -2.7)],
        {"size": (640, 480), "focal": 600.0},
    )
    views = wall_views(wall, places, painter=detailed, **large)
    (held,) = wall_views(wall, [(0.1, -0.05, -2.0)], painter=detailed, **large)
    selection = select_views(*wall, views, TextureSettings(smoothness=20))
    settings = AtlasSettings(page_size=1024, blend_rings=0, charts=charts)
    atlas = bake_atlas(tmp_path, "a", *wall, selection, views, settings)
    pages = [replace(held, camera=page_camera(1024), image=path) for path in atlas.paths]
    on_pages = SimpleNamespace(view=atlas.layout.page, uv=atlas.layout.uv, gain=np.ones((len(pages), 3)))
    for textured, images in ((selection, views), (on_pages, pages)):
        picture = render_view(held.camera, held.rotation, held.translation, *wall, textured, images)
        assert picture.covered.all()
        assert np.abs(image_offset(picture.image, held.image, picture.covered)).max() < 0.05
        assert np.abs(phase_offset(picture.image, held.image)).max() < 0.05
        assert psnr(picture.image, held.image, picture.covered) > 30


def test_without_a_texel_size_pixels_are_copied(tmp_path):
    wall = grid_mesh(48, 36)
    views = wall_views(wall, [(-0.5, 0.2, -2.8), (0.5, -0.2, -2.8)], painter=detailed, size=(640, 480))
    selection = select_views(*wall, views, TextureSettings(equalise=False))
    settings = AtlasSettings(page_size=512, blend_rings=0)
    atlas = bake_atlas(tmp_path, "a", *wall, selection, views, settings)
    copied = total = 0
    for page, path in enumerate(atlas.paths):
        chosen = np.flatnonzero((atlas.layout.page == page) & (selection.view >= 0))
        texels = rasterise(atlas.layout.uv[chosen], 512, margin=-0.5)
        face = chosen[texels.face]
        at = np.rint(np.einsum("nk,nkc->nc", texels.weights, selection.uv[face])).astype(int)
        baked = read(path)[texels.row, texels.column].astype(int)
        for number, view in enumerate(views):
            of_photo = selection.view[face] == number
            expected = view.image[at[of_photo, 1], at[of_photo, 0]]
            copied += np.count_nonzero(np.abs(baked[of_photo] - expected).max(axis=1) <= 1)
            total += np.count_nonzero(of_photo)
    assert total > 20_000
    assert copied > 0.99 * total


def phase_offset(picture, photo):
    """Shift (du, dv) by phase correlation: the slope of the phase between two pictures, low frequencies."""
    grey = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float64) for image in (photo, picture)]
    height, width = grey[0].shape
    window = cv2.createHanningWindow((width, height), cv2.CV_64F)
    first, second = (np.fft.fft2((one - one.mean()) * window) for one in grey)
    v, u = np.meshgrid(np.fft.fftfreq(height), np.fft.fftfreq(width), indexing="ij")
    low = (np.hypot(u, v) < 0.15) & (np.hypot(u, v) > 0.005)
    cross = (second * np.conj(first))[low]
    slope, weight = -2 * np.pi * np.stack([u[low], v[low]], axis=1), np.abs(cross)[:, None]
    return np.linalg.solve((weight * slope).T @ slope, (weight * slope).T @ np.angle(cross))


def page_camera(size):
    return PerspectiveCamera(size, size, [[size, 0, size / 2], [0, size, size / 2], [0, 0, 1]])


def test_unseen_faces_are_grey_and_have_room_where_charts_follow_the_surface(tmp_path, scene):
    views, selection = scene
    hidden = replace(selection, view=np.where(np.arange(len(WALL[1])) < 40, -1, selection.view))
    for charts in ("photos", "surface"):
        settings = AtlasSettings(texel_size=0.02, page_size=256, charts=charts, blend_rings=0)
        atlas = bake_atlas(tmp_path, charts, *WALL, hidden, views, settings)
        uv = atlas.layout.uv[:40]
        apart = np.abs(np.cross(*np.moveaxis(np.diff(uv, axis=1), 1, 0))) > 10
        assert apart.all() if charts == "surface" else not apart.any()
        for face in (5, 20):
            column, row = np.rint(uv[face].mean(axis=0)).astype(int)
            pixel = read(atlas.paths[atlas.layout.page[face]])[row, column]
            assert np.abs(pixel.astype(int) - 127).max() <= 1


def test_texels_coarser_than_the_photos_pixels_are_means_not_samples(tmp_path):
    """A photo of fine stripes, baked coarse, gives grey, not a moire."""
    views = wall_views(WALL, [(0.0, 0.0, -4.0)], size=(640, 480), focal=600.0)
    stripes = np.zeros((480, 640, 3), np.uint8)
    stripes[:, ::2] = 200
    views = [replace(views[0], image=stripes)]
    selection = select_views(*WALL, views, TextureSettings(smoothness=0))
    atlas = bake_atlas(tmp_path, "a", *WALL, selection, views, AtlasSettings(texel_size=0.041, page_size=256))
    chosen = np.flatnonzero((selection.view >= 0) & (atlas.layout.page == 0))
    texels = rasterise(atlas.layout.uv[chosen], 256, margin=-1)
    shown = to_linear(read(atlas.paths[0]))[texels.row, texels.column]
    assert shown.std() < 0.1 * to_linear(stripes).std()


def test_a_colour_correction_is_applied_to_what_photos_show(tmp_path, scene):
    views, selection = scene
    swap = ColourCorrection("matrix", np.eye(3)[::-1], 0.0, 0.0, 0.0, 0.0)
    settings = AtlasSettings(texel_size=0.02, page_size=256)
    plain, swapped = (
        read(bake_atlas(tmp_path, name, *WALL, selection, views, settings, correction=c).paths[0])
        for name, c in (("a", None), ("b", swap))
    )
    np.testing.assert_allclose(swapped[..., ::-1], plain, atol=1)


def test_udim_tiles_hold_the_texels(tmp_path, scene):
    views, selection = scene
    atlas = bake_atlas(tmp_path, "a", *WALL, selection, views, AtlasSettings(texel_size=0.008, page_size=256))
    assert atlas.layout.pages > 1
    assert [p.name for p in atlas.paths][:2] == ["a.1001.png", "a.1002.png"]
    tile = np.floor(atlas.udim.mean(axis=1)).astype(int)
    np.testing.assert_array_equal(tile[:, 0] + 10 * tile[:, 1], atlas.layout.page)
    assert not list(tmp_path.glob("*.part"))


def test_charts_do_not_overlap(tmp_path, scene):
    views, selection = scene
    atlas = bake_atlas(tmp_path, "a", *WALL, selection, views, AtlasSettings(texel_size=0.01, page_size=512))
    seen = selection.view >= 0
    for page in range(atlas.layout.pages):
        chosen = seen & (atlas.layout.page == page)
        texels = rasterise(atlas.layout.uv[chosen], 512, margin=-0.01)
        area = np.abs(np.cross(*np.moveaxis(np.diff(atlas.layout.uv[chosen], axis=1), 1, 0))).sum() / 2
        assert len(texels.face) == pytest.approx(area, rel=0.03)


def test_a_face_too_large_for_a_page_is_refused(tmp_path, scene):
    views, selection = scene
    with pytest.raises(TextureError, match="coarser texel size"):
        bake_atlas(tmp_path, "a", *WALL, selection, views, AtlasSettings(texel_size=0.001, page_size=128))
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot be written"):
        bake_atlas(
            tmp_path / "file", "a", *WALL, selection, views, AtlasSettings(texel_size=0.02, page_size=256)
        )
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@given(st.lists(st.tuples(st.integers(1, 60), st.integers(1, 60)), min_size=1, max_size=60))
def test_packed_boxes_lie_apart_and_inside(boxes):
    box = np.array(boxes)
    page, corner, pages = pack_shelves(box, np.zeros(len(box), int), 64)
    assert page.max() == pages - 1
    taken = np.zeros((pages, 64, 64), int)
    for p, (x, y), (w, h) in zip(page, corner, box, strict=True):
        assert x + w <= 64
        assert y + h <= 64
        taken[p, y : y + h, x : x + w] += 1
    assert taken.max() == 1


def test_rasterised_weights_find_the_texel_again():
    uv = np.array([[[2.3, 1.2], [30.1, 4.7], [11.0, 25.5]], [[30.1, 4.7], [33.0, 30.0], [11.0, 25.5]]])
    texels = rasterise(uv, 40)
    back = np.einsum("nk,nkc->nc", texels.weights, uv[texels.face])
    np.testing.assert_allclose(back, np.stack([texels.column, texels.row], axis=1), atol=1e-4)
    inside = np.all(barycentric(uv[texels.face], back) >= 0, axis=1)
    area = 0.5 * sum(abs(np.cross(t[1] - t[0], t[2] - t[0])) for t in uv)
    assert inside.sum() == pytest.approx(area, rel=0.05)


def test_margins_take_the_nearest_colour():
    image = np.zeros((9, 9, 3), np.float32)
    filled = np.zeros((9, 9), bool)
    image[2, 2], image[6, 7] = 0.3, 0.9
    filled[2, 2] = filled[6, 7] = True
    fill_margins(image, filled)
    assert np.all(image[0, 0] == np.float32(0.3))
    assert np.all(image[8, 8] == np.float32(0.9))
