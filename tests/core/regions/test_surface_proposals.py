import numpy as np
import pytest
from fresco.core.jobs import drain
from fresco.core.regions.surface.index import index_surface
from fresco.core.regions.surface.proposals import propose_facets_job, propose_openings_job


def room(step=0.05):
    """Two walls at right angles, 4 x 3 and 3 x 3 m, the first with a window of 1 x 1.2 m: vertices, faces."""
    columns, rows = round(7 / step) + 1, round(3 / step) + 1
    u, v = np.meshgrid(np.arange(columns) * step, np.arange(rows) * step)
    vertices = np.stack([np.minimum(u, 4).ravel(), v.ravel(), np.maximum(u - 4, 0).ravel()], axis=1)
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate(
        [np.stack([a, a + 1, a + columns], 1), np.stack([a + 1, a + columns + 1, a + columns], 1)]
    )
    middle = np.stack([u.ravel(), v.ravel()], axis=1)[faces].mean(axis=1)
    window = (np.abs(middle[:, 0] - 2) < 0.5) & (np.abs(middle[:, 1] - 1.5) < 0.6)
    vertices += np.random.default_rng(0).normal(0, 0.001, vertices.shape)
    return vertices, faces[~window]


def test_the_walls_of_a_room_are_proposed():
    vertices, faces = room()
    found = drain(propose_facets_job(index_surface(vertices, faces), vertices, faces))
    assert len(found) == 2
    assert sorted(p.area for p in found) == pytest.approx([9, 4 * 3 - 1.2], rel=0.05)


def test_a_window_is_proposed_and_the_scan_s_border_is_not():
    vertices, faces = room()
    found = drain(propose_openings_job(index_surface(vertices, faces), vertices, faces, least_area=0.1))
    assert len(found) == 1
    assert found[0].area == pytest.approx(1.2, rel=0.05)
    assert np.allclose(found[0].region.centre, [2, 1.5, 0], atol=0.05)


def test_names_follow_the_order_and_small_loops_do_no_harm():
    vertices, faces = room()
    index = index_surface(vertices, faces)
    facets = drain(propose_facets_job(index, vertices, faces))
    assert [facet.region.name for facet in facets] == ["Facet 1", "Facet 2"]
    holed = np.delete(faces, [40, 700], axis=0)  # loops of three edges
    openings = drain(propose_openings_job(index_surface(vertices, holed), vertices, holed, 0.1))
    assert [opening.region.name for opening in openings] == ["Opening 1"]
