from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from fresco.core.settings import AtlasSettings, TextureSettings
from fresco.core.texture import bake_atlas, select_views
from fresco.core.texture.colour.bands import PhotoBands, mix_bands
from fresco.core.texture.views.images import to_linear
from fresco.core.texture.views.visibility import project
from painted_scenes import grid_mesh, wall_views

WALL = grid_mesh(32, 24)
PLACES = [(-1.0, 0.0, -3.6), (1.0, 0.0, -3.6)]


def plain(points):
    return np.full((len(points), 3), 0.3)


def striped(points):
    """Vertical stripes 5 cm wide."""
    return 0.3 + 0.1 * np.sign(np.sin(points[:, :1] * np.pi / 0.05)) * np.ones((1, 3))


@pytest.fixture(scope="module")
def halves():
    """Two photos of a plain wall, one a tenth brighter, and the wall divided between them down the middle."""
    views = wall_views(WALL, PLACES, exposures=[1.0, 1.1], painter=plain)
    return views, divided(views)


def divided(views):
    selection = select_views(*WALL, views, TextureSettings(equalise=False, check_poses=False, smoothness=20))
    right = WALL[0][WALL[1]].mean(axis=1)[:, 0] > 0
    both = [project(view, WALL[0])[WALL[1]] for view in views]
    view = np.where(selection.view >= 0, right.astype(np.int32), -1).astype(np.int32)
    return replace(selection, view=view, uv=np.where(right[:, None, None], both[1], both[0]))


def test_shares_add_up_in_every_band_and_widen_downwards(halves):
    views, selection = halves
    mix = mix_bands(*WALL, selection, views, 4, None)
    assert mix.share.shape[0] == 3  # rings 1, 2 and 4
    assert mix.scale.shape == (2, 2)
    np.testing.assert_allclose(mix.scale[0] / mix.scale[1], 2, rtol=1e-6)
    for band in mix.share:
        total = np.stack([np.bincount(mix.face, band[:, k], len(WALL[1])) for k in range(3)])
        np.testing.assert_allclose(total[:, selection.view >= 0], 1, atol=1e-5)
    mixed = [np.count_nonzero((band > 0).any(axis=1) & (band < 1).any(axis=1)) for band in mix.share]
    assert mixed[0] < mixed[1] < mixed[2]
    assert mix.alone.any()
    assert not mix.alone.all()


def test_nothing_is_blended_without_rings(halves):
    views, selection = halves
    mix = mix_bands(*WALL, selection, views, 0, None)
    assert mix.alone.all()
    assert len(mix.scale) == 0


def test_equal_shares_put_a_photo_together_again():
    image = np.random.default_rng(0).integers(20, 230, (120, 160, 3), dtype=np.uint8)
    view = replace(wall_views(WALL, PLACES[:1], size=(160, 120))[0], image=image)
    bands = PhotoBands.of_photo(view, 0, np.array([1.1, 1.0, 0.9]), np.array([0.25, 0.125]), 1.0)
    pixels = np.random.default_rng(1).uniform(3, 100, (500, 2))
    share = np.full((3, 500), 0.4, np.float32)
    np.testing.assert_allclose(bands.mixed(pixels, share), 0.4 * bands.whole(pixels), atol=1e-6)
    # The lowest band alone is the photo without its detail.
    share[:2] = 0
    assert bands.mixed(pixels, share).std() < 0.2 * bands.whole(pixels).std()


def across(folder, views, selection, rings):
    """Linear grey values along a row of the wall from an atlas, left to right, and their places x."""
    settings = AtlasSettings(texel_size=0.012, page_size=512, blend_rings=rings)
    atlas = bake_atlas(folder, "a", *WALL, selection, views, settings)
    pages = [to_linear(cv2.imread(str(path)))[..., 1] for path in atlas.paths]
    x = np.linspace(-1.0, 1.0, 400)
    points = np.stack([x, np.full(400, 0.031), 0 * x], axis=1)
    corners = WALL[0][WALL[1]]
    shown = np.empty(400)
    for number, point in enumerate(points):
        a, b = corners[:, 1, :2] - corners[:, 0, :2], corners[:, 2, :2] - corners[:, 0, :2]
        p = point[:2] - corners[:, 0, :2]
        v = np.cross(p, b) / np.cross(a, b)
        w = np.cross(a, p) / np.cross(a, b)
        face = np.argmax(np.minimum(np.minimum(v, w), 1 - v - w))
        uv = np.array([1 - v[face] - w[face], v[face], w[face]]) @ atlas.layout.uv[face]
        page = pages[atlas.layout.page[face]]
        shown[number] = cv2.remap(page, *uv.astype(np.float32).reshape(2, 1, 1), cv2.INTER_LINEAR)[0, 0]
    return x, shown


def test_a_step_fades_over_several_rings(tmp_path, halves):
    x, sharp = across(tmp_path, *halves, rings=0)
    _, faded = across(tmp_path, *halves, rings=4)
    assert np.abs(np.diff(sharp)).max() > 0.02
    assert np.abs(np.diff(faded)).max() < 0.004
    assert np.ptp(faded[np.abs(x) < 0.25]) > 0.02  # the two photos still differ: nothing was made equal
    assert np.all(np.diff(cv2.blur(faded[None], (15, 1))[0][np.abs(x) < 0.4]) > -2e-4)


def test_detail_is_not_shown_twice_beyond_one_ring(tmp_path):
    """One photo's pose is off by half a stripe: two rings away from the seam stripes keep their contrast."""
    views = wall_views(WALL, PLACES, painter=striped, size=(640, 480), focal=600.0)
    selection = divided(views)
    moved = replace(views[1], translation=views[1].translation + views[1].rotation @ [0.05, 0, 0])
    _, shown = across(tmp_path, [views[0], moved], selection, rings=4)
    x = np.linspace(-1.0, 1.0, 400)
    contrast = [np.ptp(shown[np.abs(x - at) < 0.06]) for at in (-0.6, -0.32, 0.32, 0.6)]
    assert min(contrast[1:3]) > 0.9 * min(contrast[0], contrast[3])
