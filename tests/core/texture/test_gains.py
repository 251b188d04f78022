from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fresco.core.settings import TextureSettings
from fresco.core.texture import select_views
from fresco.core.texture.views.images import to_bytes, to_linear, to_srgb
from painted_scenes import grid_mesh, wall_views

WALL = grid_mesh(32, 24)
PLACES = [(-1.2, 0.3, -4.0), (1.2, -0.2, -4.2), (0.0, 0.1, -3.6), (-0.4, -0.5, -3.9), (0.5, 0.6, -4.4)]
ONLY_GAINS = TextureSettings(check_poses=False, sharpness="off", reject_foreign=False, smoothness=0)


@pytest.fixture(scope="module")
def views():
    return wall_views(WALL, PLACES)


def exposed(views, factors, random):
    """The photos taken again with linear RGB factors, clipped at white, with a grey level of noise."""
    found = []
    for view, factor in zip(views, factors, strict=True):
        levels = 255 * to_srgb(to_linear(view.image) * factor) + random.normal(size=view.image.shape)
        found.append(replace(view, image=to_bytes(levels / 255)))
    return found


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_exposure_and_white_balance_are_found_to_one_percent(views, seed):
    random = np.random.default_rng(seed)
    factors = 2.0 ** (random.uniform(-0.5, 0.5, (5, 1)) + random.uniform(-0.2, 0.2, (5, 3)))
    gain = select_views(*WALL, exposed(views, factors, random), ONLY_GAINS).gain
    left = np.log(gain * factors)
    assert np.abs(left - left.mean(axis=0)).max() < 0.01
    np.testing.assert_allclose(np.median(gain, axis=0), 1, atol=1e-9)


def test_the_anchor_keeps_its_colours(views):
    factors = np.array([[0.8], [1.3], [1.0], [1.1], [0.9]]) * np.ones(3)
    taken = exposed(views, factors, np.random.default_rng(4))
    gain = select_views(*WALL, taken, replace(ONLY_GAINS, gain_anchor=1)).gain
    np.testing.assert_allclose(gain[1], 1)
    np.testing.assert_allclose(gain, 1.3 / factors, rtol=0.01)
