from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from fresco.core.texture import select_views
from fresco.core.texture.coverage import measure_coverage, next_standpoints
from painted_scenes import box_mesh, grid_mesh, join, wall_views

WALL = grid_mesh(40, 30, 8.0, 6.0)


def test_coverage_counts_area_and_texel_size():
    views = wall_views(WALL, [(0, 0, -3.0)])
    selection = select_views(*WALL, views)
    coverage = measure_coverage(*WALL, selection, wanted_texel=0.011)
    frame = (320 / 300 * 3) * (240 / 300 * 3)
    assert coverage.total == pytest.approx(48)
    assert 0.8 * frame < coverage.seen <= frame
    assert coverage.texel_size == pytest.approx(3 / 300, rel=0.12)
    assert coverage.sharp_enough == coverage.seen
    assert measure_coverage(*WALL, selection, wanted_texel=0.009).sharp_enough == 0
    assert coverage.views == pytest.approx(1)


def test_the_next_photo_is_to_be_taken_where_nothing_is_seen():
    views = wall_views(WALL, [(-2.4, 0, -3.0)], target=(-2.4, 0, 0))
    selection = select_views(*WALL, views)
    places = next_standpoints(*WALL, selection, views[0].camera, wanted_texel=0.02, up=(0, -1, 0))
    assert places
    assert places[0].centre[0] > 0
    assert places[0].centre[2] < 0
    assert places[0].direction @ (0, 0, 1) > 0.99
    assert all(a.gain >= b.gain for a, b in pairwise(places))
    assert places[0].gain > 10


def test_places_stay_out_of_the_scan():
    room = join(WALL, box_mesh((-4, -3, -2.2), (4, 3, -2.0)))
    room = (room[0], room[1])
    views = wall_views(WALL, [(0, 0, -3.0)])
    selection = select_views(*room, views)
    for place in next_standpoints(*room, selection, views[0].camera, wanted_texel=0.01, up=(0, -1, 0)):
        inside = np.all((place.centre > (-4, -3, -2.2)) & (place.centre < (4, 3, -2.0)))
        assert not inside


def test_nothing_is_proposed_when_all_is_fine():
    small = grid_mesh(10, 8, 1.0, 0.8)
    views = wall_views(small, [(0, 0, -2.0)])
    selection = select_views(*small, views)
    assert next_standpoints(*small, selection, views[0].camera, wanted_texel=0.05) == []
