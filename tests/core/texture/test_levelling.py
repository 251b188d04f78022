from __future__ import annotations

import numpy as np
import pytest
from fresco.core.settings import TextureSettings
from fresco.core.texture import level_seams, select_views
from painted_scenes import grid_mesh, paint, wall_views

WALL = grid_mesh(40, 20, 6.0, 3.0)


def shaded(side):
    """Paint seen under a light that differs smoothly between two photos: at most 30 %."""

    def painter(points):
        return paint(points, 3) * (1 + side * 0.3 * np.sin(0.9 * points[:, :1] + 0.5))

    return painter


@pytest.fixture(scope="module")
def scene():
    from fresco.core.photos import View
    from painted_scenes import look_at, photograph

    flat = wall_views(WALL, [(-1.4, 0, -3.0), (1.4, 0, -3.0)], focal=260.0)
    views = []
    for view, side, x in zip(flat, (-0.5, 0.5), (-1.4, 1.4), strict=True):
        rotation, translation = look_at((x, 0, -3.0), (x, 0, 0))
        image = photograph(view.camera, rotation, translation, WALL, painter=shaded(side))
        views.append(View(view.camera, rotation, translation, image, view.name))
    return views, select_views(*WALL, views, TextureSettings(check_poses=False))


def test_steps_along_seams_shrink_much(scene):
    views, selection = scene
    levels = level_seams(*WALL, selection, views)
    assert levels.length > 1.0
    assert levels.before > 3
    assert levels.after < 0.35 * levels.before


def test_factors_are_smooth_within_a_photo_and_one_where_unseen(scene):
    views, selection = scene
    levels = level_seams(*WALL, selection, views)
    assert levels.factor.shape == (len(WALL[1]), 3, 3)
    assert np.all(levels.factor[selection.view < 0] == 1)
    assert np.abs(np.log(levels.factor).mean()) < 0.1
    # Corners of one vertex agree between faces of the same photo.
    key = selection.view[:, None] * len(WALL[0]) + WALL[1]
    for corner in np.unique(key[selection.view >= 0])[::50]:
        values = levels.factor[key == corner]
        assert np.ptp(values, axis=0).max() < 1e-6


def test_photos_that_agree_are_left_alone():
    views = wall_views(WALL, [(-1.4, 0, -3.0), (1.4, 0, -3.0)], focal=260.0)
    selection = select_views(*WALL, views)
    levels = level_seams(*WALL, selection, views)
    assert np.abs(levels.factor - 1).max() < 0.06
    assert levels.after <= levels.before + 0.1


def test_a_single_photo_has_no_seams():
    views = wall_views(WALL, [(0, 0, -3.0)], focal=260.0)
    levels = level_seams(*WALL, select_views(*WALL, views), views)
    assert levels.length == 0
    assert np.allclose(levels.factor, 1)
