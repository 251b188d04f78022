from __future__ import annotations

import numpy as np
import pytest
from fresco.core.errors import TextureError
from fresco.core.geometry.meshes import vertex_normals
from fresco.core.texture import level_seams, select_views
from fresco.core.texture.models.colours import colour_vertices, select_views_for_points
from fresco.core.texture.views.images import to_bytes, to_srgb
from painted_scenes import box_mesh, grid_mesh, join, paint, wall_views

WALL = grid_mesh(40, 30)
PLACES = [(-1.2, 0.3, -4.0), (1.2, -0.2, -4.2), (0.0, 0.1, -3.6)]


@pytest.fixture(scope="module")
def views():
    return wall_views(WALL, PLACES, exposures=[0.8, 1.0, 1.25])


def difference(rgb, points):
    return np.abs(rgb.astype(float) - to_bytes(to_srgb(paint(points)))).mean()


def test_vertices_show_the_paint(views):
    selection = select_views(*WALL, views)
    colours = colour_vertices(*WALL, selection, views, level_seams(*WALL, selection, views))
    inner = colours.seen & np.all(np.abs(WALL[0][:, :2]) < (1.9, 1.4), axis=1)
    assert colours.seen.mean() > 0.95
    assert difference(colours.rgb[inner], WALL[0][inner]) < 3


@pytest.mark.parametrize("method", ["depth", "hull"])
def test_points_of_a_cloud_show_the_paint(views, method):
    random = np.random.default_rng(4)
    points = np.append(random.uniform((-1.8, -1.3), (1.8, 1.3), (20_000, 2)), np.zeros((20_000, 1)), axis=1)
    normals = np.tile([0.0, 0.0, -1.0], (20_000, 1))
    selection = select_views_for_points(points, normals, views, method=method)
    seen = selection.colours.seen
    assert seen.mean() > 0.95
    assert difference(selection.colours.rgb[seen], points[seen]) < 3
    chosen = np.flatnonzero(seen)[::500]
    for point in chosen:
        view = views[selection.view[point]]
        pixel = view.camera.project((points[point] @ view.rotation.T + view.translation)[None])[0]
        np.testing.assert_allclose(selection.pixel[point], pixel, atol=1e-9)
    # The texel size is that of a frontal view within what the angle of the photos adds.
    assert np.nanmedian(selection.texel_size) == pytest.approx(3.8 / 300, rel=0.1)


def test_vertices_behind_a_box_are_not_painted_with_it():
    """Best photo per vertex in a room where every photo has hidden parts: PSNR against the known paint."""
    room = join(grid_mesh(80, 60), box_mesh((-0.5, -0.5, -1.2), (0.3, 0.6, -0.6), cells=30))
    places = [(-1.9, 0.4, -3.6), (1.9, -0.3, -3.6), (0.2, 1.3, -3.8), (0.0, -1.2, -3.7)]
    views = wall_views(room, places, exposures=[0.75, 1.0, 1.2, 1.0], size=(640, 480), focal=560.0)
    vertices, faces = room
    normals = vertex_normals(vertices, faces)
    points = select_views_for_points(vertices, normals, views)
    whole = colour_vertices(*room, select_views(*room, views), views)
    for found in (points.colours, whole):
        judged = found.seen & np.all(np.abs(vertices[:, :2]) < (1.85, 1.35), axis=1)
        assert judged.sum() > 0.7 * len(vertices)
        error = found.rgb[judged].astype(float) - to_bytes(to_srgb(paint(vertices[judged])))
        assert 10 * np.log10(255**2 / np.mean(error**2)) > 33


def test_an_empty_cloud_is_refused(views):
    with pytest.raises(TextureError, match="at least one point"):
        select_views_for_points(np.zeros((0, 3)), None, views)
