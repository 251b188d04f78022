from __future__ import annotations

import numpy as np
import pytest
from fresco.core.errors import TextureError
from fresco.core.settings import AtlasSettings, TextureSettings
from fresco.core.texture import bake_atlas, select_views, simplify_mesh, surface_deviation
from painted_scenes import box_mesh, detailed, grid_mesh, join, wall_views

FAR = np.array([5_000_000.0, 1_000_000.0, 200.0])


def wavy(columns=60, rows=45, height=0.02):
    vertices, faces = grid_mesh(columns, rows)
    vertices[:, 2] = height * np.sin(3 * vertices[:, 0]) * np.cos(2 * vertices[:, 1])
    return vertices, faces


def test_the_deviation_of_shifted_walls_is_the_shift():
    vertices, faces = grid_mesh(8, 6)
    coarse = grid_mesh(1, 1)
    found = surface_deviation((vertices + FAR, faces), (coarse[0] + FAR + [0, 0, 0.013], coarse[1]), 5000)
    for value in (found.median, found.rms, found.percentile_95, found.maximum, found.lost, found.added):
        assert value == pytest.approx(0.013, abs=1e-6)


def test_what_one_mesh_lacks_is_lost_not_added():
    wall, box = grid_mesh(8, 6), box_mesh((-0.2, -0.2, -0.5), (0.2, 0.2, -0.1))
    found = surface_deviation(join(wall, box), wall, 20_000)
    assert found.lost == pytest.approx(0.5, abs=0.005)
    assert found.added < 1e-9


def test_a_simplified_mesh_has_the_faces_asked_for_and_tells_its_error():
    vertices, faces = wavy()
    simple = simplify_mesh(vertices + FAR, faces, face_count=1500)
    assert len(simple.faces) <= 1575
    assert simple.vertices.mean(axis=0) == pytest.approx(FAR, abs=0.1)
    true = 0.02 * np.sin(3 * (simple.vertices - FAR)[:, 0]) * np.cos(2 * (simple.vertices - FAR)[:, 1])
    assert np.abs((simple.vertices - FAR)[:, 2] - true).max() < 0.003
    assert 0 < simple.deviation.median <= simple.deviation.rms <= simple.deviation.maximum < 0.004


def test_a_tolerance_is_held_and_used():
    vertices, faces = wavy()
    fine, coarse = (simplify_mesh(vertices, faces, tolerance=t) for t in (0.0005, 0.002))
    assert fine.deviation.percentile_95 <= 0.00055
    assert coarse.deviation.percentile_95 <= 0.0022
    assert len(coarse.faces) < 0.7 * len(fine.faces) < 0.7 * len(faces)


def test_borders_of_holes_stay():
    vertices, faces = grid_mesh(40, 30)
    centre = vertices[faces].mean(axis=1)
    open_wall = faces[(np.abs(centre[:, :2]) > (0.5, 0.4)).any(axis=1)]
    simple = simplify_mesh(vertices, open_wall, face_count=600)
    assert simple.deviation.maximum < 1e-3
    points = simple.vertices[simple.faces].mean(axis=1)
    assert (np.abs(points[:, :2]) > (0.49, 0.39)).any(axis=1).all()


@pytest.mark.parametrize(
    ("wish", "says"),
    [
        ({}, "how many faces"),
        ({"face_count": 10, "tolerance": 0.1}, "how many faces"),
        ({"face_count": 2}, "at least 4"),
        ({"face_count": 10**6}, "fewer than that"),
        ({"tolerance": -1.0}, "greater than 0"),
    ],
)
def test_a_wish_that_cannot_be_met_is_refused(wish, says):
    with pytest.raises(TextureError, match=says):
        simplify_mesh(*grid_mesh(8, 6), **wish)


def test_the_texture_of_a_simplified_mesh_shows_the_relief_of_the_detailed_one(tmp_path):
    """A wall with relief becomes a flat one; each texel must still show the paint of the place beneath it."""
    detail = wavy(80, 60, height=0.12)
    views = wall_views(detail, [(-2.6, 0.0, -3.0), (2.6, 0.2, -3.0)], painter=detailed)
    flat = grid_mesh(8, 6)
    selection = select_views(*flat, views, TextureSettings(check_poses=False, reject_foreign=False))
    settings = AtlasSettings(texel_size=0.015, page_size=1024, blend_rings=0)
    errors = []
    for name, surface in (("with", detail), ("without", None)):
        atlas = bake_atlas(tmp_path, name, *flat, selection, views, settings, detail=surface)
        errors.append(_paint_error(atlas, flat, selection, detail))
    assert errors[0] < 0.035
    assert errors[0] < 0.4 * errors[1]


def _paint_error(atlas, flat, selection, detail):
    """RMS difference (linear) between the atlas and the paint of the detailed wall straight beneath."""
    import cv2
    from fresco.core.texture.models.raster import rasterise
    from fresco.core.texture.views.images import to_linear

    page = to_linear(cv2.imread(str(atlas.paths[0]))[..., ::-1])
    chosen = np.flatnonzero((selection.view >= 0) & (atlas.layout.page == 0))
    texels = rasterise(atlas.layout.uv[chosen], atlas.layout.size, margin=-0.5)
    places = np.einsum("nk,nkc->nc", texels.weights, flat[0][flat[1][chosen[texels.face]]])
    inner = np.all(np.abs(places[:, :2]) < (1.7, 1.2), axis=1)
    places[:, 2] = 0.12 * np.sin(3 * places[:, 0]) * np.cos(2 * places[:, 1])
    difference = page[texels.row, texels.column][inner] - detailed(places[inner])
    return float(np.sqrt(np.mean((difference - np.median(difference, axis=0)) ** 2)))
