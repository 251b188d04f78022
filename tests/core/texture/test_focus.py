"""Sharpness: by comparison, as published, and by the lens's settings, on photos whose blur is known."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from fresco.core.geometry.rigid import exp_so3
from fresco.core.photos import Exif
from fresco.core.settings import TextureSettings
from fresco.core.texture import select_views
from fresco.core.texture.surface import Surface
from fresco.core.texture.views import focus_range
from fresco.core.texture.views.focus_range import focus_from_exif, sharp_range, window_measure
from fresco.core.texture.views.visibility import visible_faces
from painted_scenes import detailed, grid_mesh, wall_views

WALL = grid_mesh(60, 45, 6.0, 4.5)
PLACES = [(x, y, -4.0) for x in (-1.5, -0.5, 0.5, 1.5) for y in (-0.4, 0.5)]
FREE = TextureSettings(smoothness=0, reject_foreign=False, check_poses=False)


@pytest.fixture(scope="module")
def views():
    return wall_views(WALL, PLACES, focal=560.0, size=(640, 480), painter=detailed)


@pytest.fixture(scope="module")
def corridor():
    """Return a long wall seen along it, from 3 to 15 m, and a photo of equally fine detail everywhere."""
    mesh = grid_mesh(160, 30, 16.0, 3.0)
    turned = mesh[0] @ exp_so3([0.0, np.radians(70), 0.0]).T
    view = wall_views((turned, mesh[1]), [(0.5, 0, -7.5)], focal=560.0, size=(640, 480))[0]
    noise = np.random.default_rng(4).normal(128, 40, (480, 640, 3))
    view = replace(view, image=np.clip(noise, 0, 255).astype(np.uint8))
    seen = visible_faces(Surface.from_mesh(turned, mesh[1]), view, TextureSettings())
    return (turned, mesh[1]), view, seen


def defocused(image, seen, sigma_of_distance):
    """Blur a photo by the distance of what it shows, from a stack of evenly blurred ones."""
    distance = np.zeros(image.shape[:2], np.float32)
    weight = np.zeros_like(distance)
    at = np.clip(np.rint(seen.centre), 0, (image.shape[1] - 1, image.shape[0] - 1)).astype(int)
    np.add.at(distance, (at[:, 1], at[:, 0]), seen.distance)
    np.add.at(weight, (at[:, 1], at[:, 0]), 1)
    weight = cv2.GaussianBlur(weight, (0, 0), 6)
    distance = np.where(weight > 1e-4, cv2.GaussianBlur(distance, (0, 0), 6) / np.maximum(weight, 1e-6), 0.5)
    levels = np.linspace(0.0, 6.0, 13)
    stack = [image] + [cv2.GaussianBlur(image, (0, 0), sigma) for sigma in levels[1:]]
    chosen = np.argmin(np.abs(sigma_of_distance(distance)[..., None] - levels), axis=-1)
    return np.take_along_axis(np.stack(stack), chosen[None, ..., None], axis=0)[0]


def test_the_measure_is_the_variance_of_the_three_detail_bands():
    noise = np.random.default_rng(0).normal(128, 5, (800, 1200))
    grey = np.clip(np.rint(noise), 0, 255).astype(np.uint8)
    measure = window_measure(np.dstack([grey] * 3))
    # White noise has its own variance in every orthonormal band; rounding adds a twelfth.
    assert np.median(measure) == pytest.approx(3 * (25 + 1 / 12), rel=0.03)
    assert measure.shape == pytest.approx((800 / 40, 1200 / 40), abs=1)  # windows of 200 px at 24 megapixels
    assert window_measure(np.full((400, 600, 3), 90, np.uint8)).max() == 0


def test_published_windows_find_the_depth_of_field(corridor):
    _, view, seen = corridor
    focus, rate = 1 / 5.0, 25.0
    photo = defocused(view.image, seen, lambda d: np.minimum(rate * np.abs(1 / d - focus), 6.0))
    near, far = sharp_range(photo, seen, threshold=100.0)
    assert seen.distance.min() < 0.7 * near
    assert near < 5.0 < far < 0.9 * seen.distance.max()
    # Where the blur passes two pixels all fine detail is gone.
    assert 1 / near - focus < 2 / rate and focus - 1 / far < 2 / rate
    all_sharp = sharp_range(view.image, seen, threshold=100.0)
    assert all_sharp[0] < near and all_sharp[1] > far
    plain = np.full_like(view.image, 100)
    assert sharp_range(plain, seen, threshold=1.1) == (np.inf, 0.0)


def test_published_selection_uses_a_photo_only_within_its_range(corridor):
    mesh, view, seen = corridor
    photo = defocused(view.image, seen, lambda d: np.minimum(25.0 * np.abs(1 / d - 0.2), 6.0))
    settings = replace(FREE, sharpness="published", focus_threshold=100.0)
    blurred = select_views(*mesh, [replace(view, image=photo)], settings)
    distance = np.linalg.norm(mesh[0][mesh[1]].mean(axis=1) - view.centre, axis=1)
    used = distance[blurred.view == 0]
    assert len(used) > 200
    near, far = sharp_range(photo, seen, 100.0)
    assert used.min() >= near - 1e-3 and used.max() <= far + 1e-3
    every = select_views(*mesh, [replace(view, image=photo)], FREE)
    assert np.count_nonzero(every.view == 0) > 1.3 * len(used)


def test_the_lens_tells_its_depth_of_field():
    exif = Exif(aperture=8.0, focal_length=50.0, focus_distance=5.0)
    lens = focus_from_exif(exif, focal_pixels=8000.0)
    pitch = 50.0 / 8000.0  # mm
    confusion = 0.02
    hyperfocal = 50.0**2 / (8.0 * confusion) * 1e-3  # m, of a thin lens
    limits = hyperfocal * 5.0 / np.array([hyperfocal + 5.0, hyperfocal - 5.0])
    np.testing.assert_allclose(4 * lens.blur(limits) * pitch, confusion, rtol=1e-6)
    assert lens.blur(np.array([5.0]))[0] == pytest.approx(0, abs=1e-6)
    infinity = focus_from_exif(replace(exif, focus_distance=4294967295.0), 8000.0)
    assert infinity.blur(np.array([1e9]))[0] == pytest.approx(0, abs=1e-3)
    for missing in ("aperture", "focal_length", "focus_distance"):
        assert focus_from_exif(replace(exif, **{missing: None}), 8000.0) is None


def test_the_lens_speaks_where_no_other_photo_does(corridor, tmp_path, monkeypatch):
    mesh, view, _ = corridor
    path = tmp_path / "alone.png"
    cv2.imwrite(str(path), view.image[..., ::-1])
    alone = replace(view, image=path)
    assert np.nanmax(select_views(*mesh, [alone], FREE).blur) == 0
    exif = Exif(aperture=4.0, focal_length=85.0, focus_distance=4.0)
    monkeypatch.setattr(focus_range, "read_exif", lambda path: exif)
    selection = select_views(*mesh, [alone], FREE)
    seen = selection.view == 0
    distance = np.linalg.norm(mesh[0][mesh[1]].mean(axis=1) - view.centre, axis=1)[seen]
    expected = focus_from_exif(exif, 560.0).blur(distance)
    np.testing.assert_allclose(selection.blur[seen], expected, rtol=0.02, atol=1e-3)


@pytest.mark.parametrize("direction", ["across", "down"])
def test_a_photo_with_motion_blur_is_used_less(views, direction):
    kernel = np.zeros((9, 9), np.float32)
    if direction == "across":
        kernel[4] = 1 / 9
    else:
        kernel[:, 4] = 1 / 9
    moved = list(views)
    moved[4] = replace(views[4], image=cv2.filter2D(views[4].image, -1, kernel))
    before, after = select_views(*WALL, views, FREE), select_views(*WALL, moved, FREE)
    assert np.mean(after.view == 4) < 0.5 * np.mean(before.view == 4)
    others = after.view != 4
    assert np.nanmedian(after.blur[others & (after.view >= 0)]) < 0.5


def test_glitter_in_one_photo_does_not_make_the_others_blurred(views):
    image = views[3].image.copy()
    random = np.random.default_rng(5)
    at = random.integers((100, 150), (380, 490), (400, 2))
    image[at[:, 0], at[:, 1]] = 250  # one-pixel sparkles, as of gilding or wet stone
    glossy = list(views)
    glossy[3] = replace(views[3], image=image)
    selection = select_views(*WALL, glossy, FREE)
    others = (selection.view >= 0) & (selection.view != 3)
    assert np.nanpercentile(selection.blur[others], 90) < 0.6
    # Photos of nearly the same resolution may change places, but none is taken that shows the wall coarser.
    plain = select_views(*WALL, views, FREE)
    changed = (selection.view == 3) & (plain.view != 3)
    coarser = np.log2(selection.texel_size[changed] / plain.texel_size[changed])
    assert np.max(coarser) < 0.2
