from __future__ import annotations

import cv2
import numpy as np
import pytest
from fresco.core.errors import OutputError, TextureError
from fresco.core.settings import AtlasSettings, TextureSettings
from fresco.core.texture import bake_atlas, level_seams, select_views
from fresco.core.texture.atlas import fill_margins
from fresco.core.texture.charts import pack_shelves
from fresco.core.texture.images import to_linear
from fresco.core.texture.raster import barycentric, rasterise
from hypothesis import given
from hypothesis import strategies as st
from painted_scenes import grid_mesh, paint, wall_views

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
    out = fill_margins(image, filled)
    assert np.all(out[0, 0] == np.float32(0.3))
    assert np.all(out[8, 8] == np.float32(0.9))
