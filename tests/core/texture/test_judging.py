"""Photos that contradict the others: wrong poses, strangers, blur."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from fresco.core.geometry.rigid import exp_so3
from fresco.core.settings import TextureSettings
from fresco.core.texture import select_views
from painted_scenes import box_mesh, detailed, grid_mesh, join, wall_views

ROOM = join(grid_mesh(60, 45, 6.0, 4.5), box_mesh((-1.6, -2.0, -0.8), (-1.2, 2.0, -0.4), 12))
PLACES = [(x, y, -4.0) for x in (-1.5, -0.5, 0.5, 1.5) for y in (-0.4, 0.5)]


@pytest.fixture(scope="module")
def views():
    return wall_views(
        ROOM, PLACES, exposures=np.linspace(0.8, 1.2, 8), focal=560.0, size=(640, 480), painter=detailed
    )


def turned(view, axis, degrees):
    rotation = exp_so3(np.radians(degrees) * np.asarray(axis)) @ view.rotation
    return replace(view, rotation=rotation, translation=-rotation @ view.centre)


def test_right_poses_are_left_alone(views):
    selection = select_views(*ROOM, views)
    assert not selection.left_out.any()
    assert selection.warnings == []
    assert np.nanmax(selection.pose_shift) < 1.5
    assert np.nanmin(selection.pose_matched) > 0.7


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1)], ids=["pitch", "yaw", "roll"])
def test_a_photo_turned_by_one_degree_is_named_and_left_out(views, axis):
    changed = list(views)
    changed[3] = turned(views[3], axis, 1.0)
    selection = select_views(*ROOM, changed)
    assert np.flatnonzero(selection.left_out).tolist() == [3]
    assert np.all(selection.view != 3)
    assert "p3" in selection.warnings[0]
    if axis[2] == 0:  # one degree at a focal length of 560 pixels
        assert selection.pose_shift[3] == pytest.approx(560 * np.radians(1), rel=0.25)
    assert np.array_equal(np.isfinite(selection.predicted_shift), selection.view >= 0)


def test_a_photo_of_something_else_is_left_out(views):
    changed = list(views)
    other = np.random.default_rng(0).integers(0, 255, (120, 160, 3)).astype(np.uint8)
    changed[5] = replace(views[5], image=cv2.resize(other, (640, 480), interpolation=cv2.INTER_CUBIC))
    selection = select_views(*ROOM, changed)
    assert selection.left_out.tolist() == [False] * 5 + [True] + [False] * 2
    assert "not found in the other photos" in selection.warnings[0]


def test_a_stranger_is_not_in_the_texture_where_others_see_the_wall(views):
    changed, where = list(views), {}
    for number in (2, 5):
        image = views[number].image.copy()
        cv2.ellipse(image, (330, 260), (45, 110), 0, 0, 360, (40, 30, 90), -1)
        changed[number] = replace(views[number], image=image)
        where[number] = ((330, 260), (45, 110))
    # Without smoothing every photo is the best somewhere, strangers too.
    settings = TextureSettings(smoothness=0)
    before = select_views(*ROOM, changed, replace(settings, reject_foreign=False))
    after = select_views(*ROOM, changed, settings)

    def strange(selection):
        count = 0
        for number, (centre, axes) in where.items():
            faces = (selection.view == number) & (selection.view_count >= 3)
            at = (selection.uv[faces].mean(axis=1) - centre) / axes
            count += np.count_nonzero(np.sum(at**2, axis=1) < 1)
        return count

    assert strange(before) > 30
    assert strange(after) == 0
    assert np.mean(after.view >= 0) == np.mean(before.view >= 0)
    assert np.all(after.foreign_share[[2, 5]] > 0.02)
    assert after.foreign_share[[0, 1, 3, 4, 6, 7]].max() < 0.02


def test_blur_is_measured_where_photos_share_a_surface(views):
    changed = list(views)
    blurred = cv2.GaussianBlur(views[4].image, (0, 0), 2.5)
    changed[4] = replace(views[4], image=blurred)
    settings = TextureSettings(smoothness=0)
    before, after = select_views(*ROOM, views, settings), select_views(*ROOM, changed, settings)
    assert np.mean(after.view == 4) < 0.4 * np.mean(before.view == 4)
    sharp = before.blur[before.view >= 0]
    assert np.median(sharp) < 0.5


def test_a_plain_wall_is_not_taken_for_blur(views):
    plain = wall_views(
        ROOM, PLACES[:4], focal=560.0, size=(640, 480), painter=lambda p: np.full((len(p), 3), 0.4)
    )
    selection = select_views(*ROOM, plain)
    seen = selection.view >= 0
    assert not selection.left_out.any()
    assert np.nanmax(selection.blur[seen]) < 0.5


def test_few_large_patches_instead_of_confetti(views):
    from fresco.core.geometry.meshes import edge_pairs

    pairs = edge_pairs(ROOM[1], len(ROOM[0])).face

    def changes(selection):
        return np.count_nonzero(selection.view[pairs[:, 0]] != selection.view[pairs[:, 1]])

    rough = select_views(*ROOM, views, TextureSettings(smoothness=0))
    smooth = select_views(*ROOM, views)
    again = select_views(*ROOM, views)
    smoother = select_views(*ROOM, views, TextureSettings(smoothness=40))
    assert changes(smoother) < 0.6 * changes(rough)
    assert changes(smoother) < changes(smooth) < 0.75 * changes(rough)
    assert np.array_equal(smooth.view, again.view)
    assert np.array_equal(smooth.view >= 0, rough.view >= 0)


def test_priorities_prefer_and_exclude(views):
    none = [0.0] * 8
    excluded = select_views(*ROOM, views, priorities=[-np.inf, *none[1:]])
    assert np.all(excluded.view != 0)
    preferred = select_views(*ROOM, views, priorities=[3.0, *none[1:]])
    plain = select_views(*ROOM, views)
    assert np.mean(preferred.view == 0) > 2 * np.mean(plain.view == 0)
