from __future__ import annotations

import threading
from dataclasses import fields, replace

import cv2
import numpy as np
import pytest
from fresco.core.errors import PhotoError, TextureError
from fresco.core.jobs import drain
from fresco.core.settings import TextureSettings
from fresco.core.texture import Selection, select_views, select_views_job
from painted_scenes import box_mesh, grid_mesh, join, wall_views

WALL = grid_mesh(24, 18)
PLACES = [(-1.2, 0.3, -4.0), (1.2, -0.2, -4.2), (0.0, 0.1, -2.6)]


@pytest.fixture(scope="module")
def views():
    return wall_views(WALL, PLACES, exposures=[0.7, 1.0, 1.4])


def test_uvs_are_the_projection_of_the_corners(views):
    selection = select_views(*WALL, views)
    assert (selection.view >= 0).mean() > 0.95
    for face in range(0, len(WALL[1]), 37):
        number = selection.view[face]
        if number < 0:
            assert np.all(selection.uv[face] == 0)
            continue
        view = views[number]
        points = WALL[0][WALL[1][face]] @ view.rotation.T + view.translation
        np.testing.assert_allclose(selection.uv[face], view.camera.project(points), atol=1e-6)


def test_gains_undo_the_exposures(views):
    gain = select_views(*WALL, views).gain
    exposure = np.array([0.7, 1.0, 1.4])
    expected = 1 / exposure  # the median photo stays
    np.testing.assert_allclose(gain, np.repeat(expected[:, None], 3, 1), rtol=0.02)


def test_an_anchored_photo_keeps_its_colours(views):
    gain = select_views(*WALL, views, TextureSettings(gain_anchor=2)).gain
    np.testing.assert_allclose(gain[2], 1)
    np.testing.assert_allclose(gain[0], 2, rtol=0.03)


def test_result_does_not_depend_on_the_order_of_faces_or_on_the_origin(views):
    shift = np.array([5_000_000.0, 4_000_000.0, 300.0])
    moved = [replace(v, translation=v.translation - v.rotation @ shift) for v in views]
    order = np.random.default_rng(3).permutation(len(WALL[1]))
    plain = select_views(*WALL, views)
    other = select_views(WALL[0] + shift, WALL[1][order], moved)
    assert np.mean(other.view == plain.view[order]) > 0.99
    same = other.view == plain.view[order]
    np.testing.assert_allclose(other.uv[same], plain.uv[order][same], atol=1e-3)


def test_texel_size_and_angle_are_those_of_the_lens(views):
    selection = select_views(*WALL, views[2:])
    centre = np.argmin(np.linalg.norm(WALL[0][WALL[1]].mean(axis=1), axis=1))
    assert selection.texel_size[centre] == pytest.approx(2.6 / 300, rel=0.02)
    assert selection.angle[centre] < 5


def test_a_pillar_hides_the_wall_and_an_occluder_gets_no_texture(views):
    pillar = box_mesh((-0.3, -1.0, -1.5), (0.3, 1.0, -1.0))
    hidden = select_views(*WALL, views[2:], occluders=[pillar])
    free = select_views(*WALL, views[2:])
    assert len(hidden.view) == len(WALL[1])
    lost = (free.view >= 0) & (hidden.view < 0)
    # The pillar's shadow seen from 2.6 m: its front face at 1.1 m spreads to 2.6 / 1.1 of its size.
    x = WALL[0][WALL[1]].mean(axis=1)[:, 0]
    assert np.abs(x[lost]).max() < 0.3 * 2.6 / 1.1 + 0.2
    assert lost.sum() > 0.1 * len(lost)


def test_back_faces_are_seen_only_when_asked(views):
    turned = (WALL[0], WALL[1][:, ::-1])
    assert np.all(select_views(*turned, views).view == -1)
    assert (select_views(*turned, views, TextureSettings(double_sided=True)).view >= 0).mean() > 0.95


def test_masks_keep_parts_of_a_photo_out(views):
    mask = np.ones((240, 320), dtype=bool)
    mask[:, 160:] = False
    selection = select_views(*WALL, [replace(views[2], mask=mask)])
    seen = selection.view >= 0
    assert seen.any()
    assert selection.uv[seen][..., 0].max() <= 159.5


def test_burnt_out_parts_are_taken_from_another_photo(views):
    burnt = views[2].image.copy()
    burnt[100:160, 100:200] = 255
    own_best = TextureSettings(smoothness=0)
    plain = select_views(*WALL, [views[0], views[2]], own_best)
    selection = select_views(*WALL, [views[0], replace(views[2], image=burnt)], own_best)
    taken = plain.view == 1
    centre = plain.uv.mean(axis=1)
    inside = taken & np.all((centre > (104, 104)) & (centre < (196, 156)), axis=1)
    assert inside.sum() > 10
    assert np.mean(selection.view[inside] == 0) > 0.9


def test_two_walls_at_a_corner_take_the_photo_that_looks_at_them():
    room = join(WALL, (WALL[0] @ np.array([[0, 0, -1.0], [0, 1, 0], [1, 0, 0]]) + (2, 0, -2), WALL[1]))
    views = wall_views(room, [(-0.5, 0, -4.0)]) + wall_views(room, [(-2.0, 0, -2)], target=(2, 0, -2))
    selection = select_views(*room, views)
    first = selection.view[: len(WALL[1])]
    second = selection.view[len(WALL[1]) :]
    assert np.mean(first[first >= 0] == 0) > 0.6
    assert np.mean(second[second >= 0] == 1) > 0.6


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (WALL[0], np.zeros((0, 3), int), "no faces"),
        (np.where(WALL[0] > 1.9, np.nan, WALL[0]), WALL[1], "no finite coordinates"),
        (WALL[0][:20], WALL[1], "has 20 vertices"),
        (WALL[0], -WALL[1], "refers to vertex"),
        (WALL[0], WALL[1].astype(float), "whole vertex numbers"),
    ],
)
def test_unusable_meshes_are_refused_with_the_reason(views, vertices, faces, words):
    with pytest.raises(TextureError, match=words):
        select_views(vertices, faces, views)


def test_unusable_views_are_refused_with_the_reason(views, tmp_path):
    with pytest.raises(TextureError, match="no photos"):
        select_views(*WALL, [])
    with pytest.raises(PhotoError, match="no such photo"):
        select_views(*WALL, [replace(views[0], image=tmp_path / "lost.jpg")])
    small = tmp_path / "klein ü.png"
    small.write_bytes(cv2.imencode(".png", views[0].image[::2, ::2])[1].tobytes())
    with pytest.raises(PhotoError, match="160 x 120"):
        select_views(*WALL, [replace(views[0], image=small)])
    with pytest.raises(TextureError, match="no rotation"):
        select_views(*WALL, [replace(views[0], rotation=2 * views[0].rotation)])
    with pytest.raises(PhotoError, match="mask is 10 x 10"):
        select_views(*WALL, [replace(views[0], mask=np.ones((10, 10), bool))])


def test_files_and_arrays_give_the_same(views, tmp_path):
    files = []
    for view in views:
        path = tmp_path / f"foto {view.name} ß.png"
        path.write_bytes(cv2.imencode(".png", view.image[..., ::-1])[1].tobytes())
        files.append(replace(view, image=path))
    a, b = select_views(*WALL, views), select_views(*WALL, files)
    assert np.array_equal(a.view, b.view)
    np.testing.assert_array_equal(a.gain, b.gain)


def test_a_photo_removed_half_way_is_named(views, tmp_path):
    files = []
    for view in views:
        path = tmp_path / f"{view.name}.png"
        path.write_bytes(cv2.imencode(".png", view.image[..., ::-1])[1].tobytes())
        files.append(replace(view, image=path))
    job = select_views_job(*WALL, files, TextureSettings(threads=1))
    next(job)
    files[2].image.unlink()
    with pytest.raises(PhotoError, match=r"p2\.png"):
        drain(job)


def test_a_job_can_be_closed_at_any_step(views):
    before = threading.active_count()
    steps = len(list(select_views_job(*WALL, views)))
    assert steps > 8
    for stop in range(0, steps, 3):
        job = select_views_job(*WALL, views)
        for _ in range(stop + 1):
            next(job)
        job.close()
    assert threading.active_count() == before


def test_progress_never_goes_back(views):
    fractions = [progress.fraction for progress in select_views_job(*WALL, views)]
    assert np.all(np.diff(fractions) >= -1e-9)
    assert 0 <= fractions[0] <= fractions[-1] <= 1


def test_ten_faces_and_one_photo(views):
    selection = select_views(WALL[0], WALL[1][200:210], views[2:])
    assert selection.view.shape == (10,)
    assert np.all(selection.view == 0)
    assert np.all(selection.runner_up == -1)
    assert np.all(selection.view_count == 1)


def test_non_manifold_and_doubled_faces_are_textured_like_others(views):
    doubled = np.concatenate([WALL[1], WALL[1][100:140], WALL[1][50:60, ::-1]])
    selection = select_views(WALL[0], doubled, views)
    plain = select_views(*WALL, views)
    assert np.array_equal(selection.view[: len(WALL[1])] >= 0, plain.view >= 0)
    assert np.all(selection.view[-10:] == -1)  # these look away


def test_wrong_priorities_are_refused(views):
    with pytest.raises(TextureError, match="one priority for each of the 3 photos"):
        select_views(*WALL, views, priorities=[0.0])
    with pytest.raises(TextureError, match="All photos are left out"):
        select_views(*WALL, views, priorities=[-np.inf] * 3)


def test_several_threads_choose_as_one_does(views):
    one = select_views(*WALL, views, TextureSettings(threads=1))
    several = select_views(*WALL, views, TextureSettings(threads=3))
    for field in fields(Selection):
        if field.name != "photo_name":
            np.testing.assert_array_equal(getattr(one, field.name), getattr(several, field.name))
