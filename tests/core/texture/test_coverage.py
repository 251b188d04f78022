from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from fresco.core.geometry.meshes import face_normals
from fresco.core.settings import TextureSettings
from fresco.core.texture import select_views
from fresco.core.texture.coverage import _is_free, measure_coverage, next_standpoints
from fresco.core.texture.surface import Surface
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


def room_with_pillars():
    """A closed room of 8 x 5 x 6 m with three solid pillars and a plinth close to a wall."""
    walls = box_mesh((-4.0, -2.5, -3.0), (4.0, 2.5, 3.0), 26)
    solids = [
        ((-1.7, -2.5, -0.4), (-1.2, 2.5, 0.1)),
        ((0.9, -2.5, 0.6), (1.5, 2.5, 1.2)),
        ((2.2, -2.5, -1.8), (2.7, 2.5, -1.3)),
        ((-3.6, 1.2, 1.5), (-2.4, 2.5, 2.9)),
    ]
    return join((walls[0], walls[1][:, ::-1]), *(box_mesh(*solid, 10) for solid in solids)), solids


@pytest.mark.parametrize("wanted", [0.004, 0.008])
def test_a_proposed_photo_adds_what_it_says_and_can_be_taken(wanted):
    room, solids = room_with_pillars()
    views = wall_views(room, [(-3.0, 0.0, -2.0)], target=(2.0, 0.0, 2.0), focal=300.0, size=(640, 480))
    settings = TextureSettings(reject_foreign=False, check_poses=False, sharpness="off", smoothness=0)
    area = face_normals(*room)[1]

    def fine_area(taken):
        selection = select_views(*room, taken, settings)
        return selection, float(area[(selection.view >= 0) & (selection.texel_size <= wanted)].sum())

    selection, before = fine_area(views)
    places = next_standpoints(*room, selection, views[0].camera, wanted, count=4, up=(0, -1, 0))
    assert len(places) == 4
    for place in places:
        assert np.all(np.abs(place.centre) < (4.0, 2.5, 3.0))
        for low, high in solids:
            outside = np.maximum(np.maximum(low - place.centre, place.centre - high), 0)
            assert np.linalg.norm(outside) > 0.02
        x = np.cross((0.0, 1.0, 0.0), place.direction)
        x = x / np.linalg.norm(x) if np.linalg.norm(x) > 1e-3 else np.array([1.0, 0.0, 0.0])
        y = np.cross(place.direction, x)
        rotation = np.stack([x, y, place.direction])
        views.append(replace(views[0], rotation=rotation, translation=-rotation @ place.centre))
        selection, after = fine_area(views)
        assert after - before == pytest.approx(place.gain, rel=0.05)
        before = after


def test_no_place_inside_a_solid_is_proposed():
    room, solids = room_with_pillars()
    surface = Surface.from_mesh(*room)
    for low, high in solids:
        middle = 0.5 * (np.asarray(low) + np.asarray(high))
        assert not _is_free(surface, middle - surface.origin, 0.0)
    assert _is_free(surface, np.array([-2.6, 0.0, -1.0]) - surface.origin, 0.3)
    assert not _is_free(surface, np.array([-1.1, 0.0, -0.2]) - surface.origin, 0.3)  # a hand from a pillar


def test_nothing_is_proposed_when_all_is_fine():
    small = grid_mesh(10, 8, 1.0, 0.8)
    views = wall_views(small, [(0, 0, -2.0)])
    selection = select_views(*small, views)
    assert next_standpoints(*small, selection, views[0].camera, wanted_texel=0.05) == []
