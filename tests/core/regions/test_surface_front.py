"""What a click on the scan sees from the front: the view, its creases, frames, and the faces within them."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from fresco.core.regions.surface.candidates import find_candidates, framed_views
from fresco.core.regions.surface.cloud_index import index_cloud
from fresco.core.regions.surface.creases import find_creases
from fresco.core.regions.surface.evidence import NAMES
from fresco.core.regions.surface.framed import framed_faces, framed_level, within
from fresco.core.regions.surface.front import front_view
from fresco.core.regions.surface.index import index_surface
from fresco.core.regions.surface.robust_fit import plane_through
from fresco.core.regions.surface.wand import grow_surface, region_faces
from fresco.core.settings import RegionSettings

STEP = 0.025
FAR = np.array([3_500_000.0, 5_000_000.0, 250.0])
PANEL = np.array([[1.0, 1.0], [3.0, 1.0], [3.0, 2.0], [1.0, 2.0]])


def relief(depth, seed=1):
    """Wall of 4 x 3 m whose height is `depth` (u, v): vertices at far coordinates, faces."""
    u, v = np.meshgrid(np.arange(161) * STEP, np.arange(121) * STEP)
    vertices = np.stack([u, v, depth(u, v)], axis=-1).reshape(-1, 3)
    vertices += np.random.default_rng(seed).normal(0, 0.001, vertices.shape) + FAR
    a = (np.arange(120)[:, None] * 161 + np.arange(160)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + 161], 1), np.stack([a + 1, a + 162, a + 161], 1)])
    return vertices, faces


def in_panel(u, v):
    return (np.abs(u - 2) < 1) & (np.abs(v - 1.5) < 0.5)


def sunk(u, v):
    return np.where(in_panel(u, v), -0.08, 0.0)


def carved(u, v):
    """Panel filled with relief as deep as the panel itself."""
    lumps = 0.05 * np.sin(11 * u + 3 * np.sin(5 * v)) * np.sin(13 * v + 2 * np.sin(7 * u))
    return np.where(in_panel(u, v), -0.08 + lumps, 0.0)


@pytest.fixture(scope="module")
def panel():
    """Index of the sunk panel, and the plane of its wall around the panel's middle."""
    index = index_surface(*relief(sunk))
    return index, plane_through(np.array([2.0, 1.5, 0.0]) + FAR - index.centre, np.array([0.0, 0.0, 1.0]))


def test_a_view_shows_heights_and_normals_where_the_scan_is(panel):
    index, plane = panel
    view = front_view(index, plane, 0.02, 250)
    place = view.places(np.stack(np.meshgrid(np.arange(250), np.arange(250)), axis=-1).astype(float))
    world = (
        plane.centre + place[..., :1] * plane.axes[0] + place[..., 1:] * plane.axes[1] + index.centre - FAR
    )
    u, v = world[..., 0], world[..., 1]
    inside = (np.minimum(u, 4 - u) > 0.05) & (np.minimum(v, 3 - v) > 0.05)
    outside = (u < -0.05) | (u > 4.05) | (v < -0.05) | (v > 3.05)
    assert view.seen[inside].all()
    assert not view.seen[outside].any()
    away_from_steps = inside & (np.abs(np.abs(u - 2) - 1) > 0.06) & (np.abs(np.abs(v - 1.5) - 0.5) > 0.06)
    assert np.abs(view.height - sunk(u, v))[away_from_steps].max() < 0.006
    assert view.normal[away_from_steps][:, 2].min() > 0.95
    assert view.places(view.pixels([0.3, -0.2])) == pytest.approx([0.3, -0.2])


def test_what_is_turned_away_or_far_off_is_not_seen(panel):
    index, plane = panel
    back = plane_through(plane.centre, -plane.normal)
    assert not front_view(index, back, 0.02, 100).seen.any()
    far = plane_through(plane.centre + 5 * plane.normal, plane.normal)
    assert not front_view(index, far, 0.02, 100).seen.any()


def test_a_cloud_is_seen_without_gaps():
    vertices, _ = relief(sunk)
    index = index_cloud(vertices)
    normal = np.array([0.0, 0.0, np.sign(index.normal[:, 2].sum())])
    view = front_view(index, plane_through(np.array([2.0, 1.5, 0.0]) + FAR - index.centre, normal), 0.01, 100)
    assert view.seen.all()
    assert np.median(view.height) == pytest.approx(-0.08 * normal[2], abs=0.005)


def test_creases_are_lines_along_the_panels_sides(panel):
    index, plane = panel
    view = front_view(index, plane, 0.02, 250)
    lines = find_creases(view, index.noise).lines
    corners = view.pixels(((PANEL + FAR[:2] - index.centre[:2]) - plane.centre[:2]) @ plane.axes[:2, :2].T)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        off = np.abs((np.stack([start, end]) - lines.centre) @ lines.normal.T - lines.offset)
        assert off.max(axis=0).min() < 2.5  # cells: the step is one face wide


def test_faces_within_an_outline_are_those_near_its_surface_that_face_the_viewer(panel):
    index, plane = panel
    outline = (PANEL - [2.0, 1.5]) * 0.9 @ plane.axes[:2, :2].T
    level = framed_level(index, plane, outline, 0.0)
    assert level.area == pytest.approx(1.8 * 0.9, rel=1e-6)
    assert level.fit.distance(plane.centre[None])[0] == pytest.approx(0.08, abs=0.005)
    found = framed_faces(index, level)
    local = (index.middle - plane.centre) @ plane.axes.T
    assert np.array_equal(found, within(local[:, :2], outline))


def test_an_outline_with_a_repeated_corner_is_a_triangle():
    triangle = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [0.0, 0.0]])
    points = np.array([[0.5, 0.5], [1.5, 1.5], [-0.1, 1.0], [1.0, 0.5]])
    for outline in (triangle, triangle[::-1]):
        assert within(points, outline).tolist() == [True, False, False, True]


def test_candidates_have_all_evidence_and_hold_the_panel(panel):
    index, plane = panel
    with ThreadPoolExecutor(1) as pool:
        views = [view.result() for view in framed_views(index, plane, RegionSettings(), pool)]
    found = find_candidates(index, plane, views, ())
    assert found.evidence.shape == (len(found.loops), len(NAMES))
    assert np.all(np.isfinite(found.evidence))
    assert np.all(found.level == -1)
    middle = PANEL.mean(axis=0)
    truth = (PANEL - middle) @ plane.axes[:2, :2].T
    off = [np.abs(loop[:, None] - truth).max(axis=2).min(axis=0).max() for loop in found.loops]
    assert min(off) < 0.04


def test_a_panel_full_of_relief_is_found_whole():
    vertices, faces = relief(carved)
    index = index_surface(vertices, faces)
    local = vertices - FAR
    truth = in_panel(local[:, 0], local[:, 1])[faces].all(axis=1)
    face = int(np.argmin(np.linalg.norm(local[faces].mean(axis=1)[:, :2] - [2.0, 1.5], axis=1)))
    click = grow_surface(index, face)
    found = np.zeros(len(faces), dtype=bool)
    found[region_faces(index, face, click.level())] = True
    assert np.count_nonzero(found & truth) / np.count_nonzero(found | truth) > 0.88


def test_dragging_goes_through_frames_and_grown_regions_by_area(panel):
    index, plane = panel
    face = int(np.argmin(np.linalg.norm(index.middle - plane.centre, axis=1)))
    levels = grow_surface(index, face).levels
    areas = [level.area for level in levels]
    assert areas == sorted(areas)
    assert {level.outline is None for level in levels} == {True, False}
