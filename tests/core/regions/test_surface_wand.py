import numpy as np
import pytest
from fresco.core.errors import RegionError
from fresco.core.regions.surface.index import index_surface
from fresco.core.regions.surface.robust_fit import fit_plane, fit_quadric, fit_smooth
from fresco.core.regions.surface.wand import grow_surface, region_faces
from fresco.core.settings import RegionSettings

FAR = np.array([3_500_000.0, 5_000_000.0, 250.0])


def grid(width, height, step):
    """Regular grid in the plane z = 0: vertices (V,3), faces (F,3)."""
    columns, rows = round(width / step) + 1, round(height / step) + 1
    u, v = np.meshgrid(np.arange(columns) * step, np.arange(rows) * step)
    vertices = np.stack([u.ravel(), v.ravel(), np.zeros(u.size)], axis=1)
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate(
        [np.stack([a, a + 1, a + columns], 1), np.stack([a + 1, a + columns + 1, a + columns], 1)]
    )
    return vertices, faces


def wall(noise=0.002, seed=1):
    """Wall 4 x 3 m with a panel (1..3, 1..2) recessed by 0.1 m and a boss of 5 cm in it.

    Vertices, faces, panel faces.
    """
    vertices, faces = grid(4, 3, 0.025)
    x, y = vertices[:, 0], vertices[:, 1]
    panel = (x > 1.01) & (x < 2.99) & (y > 1.01) & (y < 1.99)
    vertices[:, 2] -= 0.1 * panel
    vertices[:, 2] += 0.05 * np.maximum(0, 1 - np.hypot(x - 1.5, y - 1.5) / 0.15)
    vertices += np.random.default_rng(seed).normal(0, noise, vertices.shape)
    return vertices, faces, panel[faces].all(axis=1)


def face_at(vertices, faces, x, y):
    middle = vertices[faces].mean(axis=1)
    return int(np.argmin(np.hypot(middle[:, 0] - x, middle[:, 1] - y)))


def clicked(vertices, faces, x, y, colours=None, settings=None):
    index = index_surface(vertices, faces, colours)
    face = face_at(vertices, faces, x, y)
    return region_faces(index, face, grow_surface(index, face, settings).level())


def overlap(found, truth):
    mask = np.zeros(len(truth), dtype=bool)
    mask[found] = True
    return np.count_nonzero(mask & truth) / np.count_nonzero(mask | truth)


def test_one_click_finds_a_recessed_panel_with_its_ornament():
    vertices, faces, panel = wall()
    found = clicked(vertices, faces, 2.0, 1.5)
    assert overlap(found, panel) > 0.95
    assert np.isin(face_at(vertices, faces, 1.5, 1.5), found)  # the boss belongs to the panel


def test_national_grid_coordinates_change_nothing():
    vertices, faces, _ = wall()
    assert np.array_equal(
        clicked(vertices, faces, 2.0, 1.5), clicked(vertices + FAR, faces, FAR[0] + 2.0, FAR[1] + 1.5)
    )


def test_a_door_stays_an_opening():
    vertices, faces, _ = wall()
    middle = vertices[faces].mean(axis=1)
    door = (np.abs(middle[:, 0] - 0.5) < 0.3) & (middle[:, 1] < 2)
    kept = faces[~door]
    found = clicked(vertices, kept, 3.5, 0.5)
    assert np.ptp(vertices[kept[found]].reshape(-1, 3), axis=0)[0] > 3.9


def test_a_vault_is_grown_as_one_curved_surface():
    vertices, faces = grid(3, 3, 0.03)
    angle = (vertices[:, 0] - 1.5) / 3
    vertices = np.stack([3 * np.sin(angle), vertices[:, 1], 3 * np.cos(angle)], axis=1)
    vertices += np.random.default_rng(0).normal(0, 0.001, vertices.shape)
    index = index_surface(vertices, faces)
    face = face_at(vertices, faces, 0.0, 1.5)
    level = grow_surface(index, face).level()
    assert level.fit.curved
    assert len(region_faces(index, face, level)) > 0.9 * len(faces)


def test_growing_stops_at_a_colour_edge_unless_told_not_to():
    vertices, faces = grid(2, 1, 0.02)
    colours = np.where(vertices[:, :1] < 1.0, [[150, 60, 50]], [[60, 90, 150]]).astype(np.uint8)
    left = vertices[faces].mean(axis=1)[:, 0] < 1.0
    assert overlap(clicked(vertices, faces, 0.5, 0.5, colours), left) > 0.93
    ignoring = RegionSettings(colour_tolerance=0)
    assert len(clicked(vertices, faces, 0.5, 0.5, colours, ignoring)) == len(faces)


@pytest.mark.parametrize("noise", [0.0005, 0.002, 0.006])
def test_the_noise_is_read_off_the_scan(noise):
    vertices, faces = grid(2, 2, 0.025)
    vertices += np.random.default_rng(5).normal(0, noise, vertices.shape)
    assert index_surface(vertices, faces).noise == pytest.approx(noise, rel=0.35)


def test_a_box_of_twelve_triangles_gives_one_side():
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])
    index = index_surface(corner, faces)
    for face in range(12):
        found = region_faces(index, face, grow_surface(index, face).level())
        assert set(found) == {face // 2 * 2, face // 2 * 2 + 1}


def test_non_manifold_scans_are_grown_all_the_same():
    vertices, faces, panel = wall()
    doubled = np.concatenate([faces, faces[:50], faces[panel][:20]])
    index = index_surface(vertices, doubled)
    face = face_at(vertices, faces, 2.0, 1.5)
    found = region_faces(index, face, grow_surface(index, face).level())
    assert overlap(found[found < len(faces)], panel) > 0.9


def test_bad_input_is_refused_with_a_sentence():
    loose = np.random.default_rng(0).random((30, 3, 3)).reshape(-1, 3)
    index = index_surface(loose, np.arange(90).reshape(-1, 3))
    with pytest.raises(RegionError, match="loose triangle"):
        grow_surface(index, 3)
    with pytest.raises(RegionError, match="not on the scan"):
        grow_surface(index, 30)
    with pytest.raises(RegionError, match="no triangles"):
        index_surface(loose, np.zeros((0, 3), dtype=int))
    with pytest.raises(RegionError, match="not numbers"):
        index_surface(np.full((3, 3), np.nan), [[0, 1, 2]])
    with pytest.raises(RegionError, match="every vertex"):
        index_surface(loose, [[0, 1, 2]], np.zeros((3, 3), dtype=np.uint8))


def test_the_plane_ignores_forty_percent_of_outliers():
    rng = np.random.default_rng(2)
    points = rng.normal(0, 1, (400, 3)) * (1, 1, 0.002)
    points[:150, 2] += rng.uniform(0.05, 1.0, 150)
    plane = fit_plane(points + FAR)
    assert np.degrees(np.arccos(abs(plane.normal[2]))) < 0.2
    assert np.median(np.abs(plane.distance(points + FAR)[150:])) < 0.003


def test_a_quadric_is_chosen_only_where_the_points_bend():
    rng = np.random.default_rng(4)
    flat = rng.uniform(-1, 1, (500, 3)) * (1, 1, 0.003)
    assert not fit_smooth(flat).curved
    bent = flat + np.stack([0 * flat[:, 0], 0 * flat[:, 0], 0.2 * flat[:, 0] ** 2], axis=1)
    fit = fit_smooth(bent)
    assert fit.curved and np.abs(fit.distance(bent)).max() < 0.01
    assert fit_quadric(bent, fit_plane(bent)).sigma < 0.003


def test_loose_triangles_are_joined_where_their_corners_coincide():
    vertices, faces, panel = wall()
    loose = vertices[faces].reshape(-1, 3)  # as STL stores them
    found = clicked(loose, np.arange(len(loose)).reshape(-1, 3), 2.0, 1.5)
    assert overlap(found, panel) > 0.93


def test_faces_without_area_do_not_tear_the_surface():
    vertices, faces, panel = wall()
    strip = np.flatnonzero(panel)[::7]
    faces = faces.copy()
    flat = vertices.copy()
    flat[faces[strip, 2]] = 0.5 * (flat[faces[strip, 0]] + flat[faces[strip, 1]])
    assert overlap(clicked(flat, faces, 2.0, 1.5), panel) > 0.9


def test_vertices_without_faces_may_be_no_numbers():
    vertices, faces, panel = wall()
    found = clicked(np.concatenate([vertices, np.full((3, 3), np.nan)]), faces, 2.0, 1.5)
    assert overlap(found, panel) > 0.93


def test_a_flush_panel_ends_at_its_shallow_step():
    vertices, faces = grid(4, 3, 0.02)
    x, y = vertices[:, 0], vertices[:, 1]
    panel = (np.abs(x - 2) < 0.7) & (np.abs(y - 1.5) < 0.5)
    vertices[:, 2] += 0.015 * panel
    vertices += np.random.default_rng(3).normal(0, 0.001, vertices.shape)
    assert overlap(clicked(vertices, faces, 2.0, 1.5), panel[faces].all(axis=1)) > 0.9


def test_a_recessed_window_is_no_ornament_of_its_wall():
    vertices, faces = grid(4, 3, 0.025)
    x, y = vertices[:, 0], vertices[:, 1]
    window = (np.abs(x - 1) < 0.4) & (np.abs(y - 1.5) < 0.6)
    vertices[:, 2] -= 0.15 * window
    vertices += np.random.default_rng(3).normal(0, 0.001, vertices.shape)
    found = clicked(vertices, faces, 2.8, 1.5)
    assert not np.isin(face_at(vertices, faces, 1.0, 1.5), found)


def test_three_faces_are_a_region():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [-1, 0.5, 0]], dtype=float)
    index = index_surface(vertices, [[0, 1, 2], [0, 2, 3], [0, 3, 4]])
    assert list(region_faces(index, 0, grow_surface(index, 0).level())) == [0, 1, 2]


def test_a_flush_panel_is_found_in_noise_of_a_quarter_of_its_step():
    vertices, faces = grid(4, 3, 0.02)
    x, y = vertices[:, 0], vertices[:, 1]
    panel = (np.abs(x - 2) < 0.7) & (np.abs(y - 1.5) < 0.5)
    vertices[:, 2] += 0.016 * panel
    vertices += np.random.default_rng(3).normal(0, 0.004, vertices.shape)
    assert overlap(clicked(vertices, faces, 2.0, 1.5), panel[faces].all(axis=1)) > 0.85


def test_a_pilaster_on_a_wall_is_no_ornament_of_it():
    vertices, faces = grid(4, 3, 0.025)
    x, y = vertices[:, 0], vertices[:, 1]
    pilaster = (np.abs(x - 1) < 0.15) & (np.abs(y - 1.5) < 1.2)
    vertices[:, 2] += 0.06 * pilaster
    vertices += np.random.default_rng(3).normal(0, 0.002, vertices.shape)
    found = clicked(vertices, faces, 2.6, 1.5)
    assert not np.isin(face_at(vertices, faces, 1.0, 1.5), found)
    assert overlap(clicked(vertices, faces, 1.0, 1.5), pilaster[faces].all(axis=1)) > 0.85


def test_a_frame_is_found_between_a_window_and_its_wall():
    vertices, faces = grid(3, 3, 0.02)
    away = np.maximum(np.abs(vertices[:, 0] - 1.5), np.abs(vertices[:, 1] - 1.5))
    frame = (away > 0.5) & (away < 0.75)
    vertices[:, 2] += np.where(frame, 0.05, np.where(away <= 0.5, -0.15, 0.0))
    vertices += np.random.default_rng(3).normal(0, 0.002, vertices.shape)
    assert overlap(clicked(vertices, faces, 1.5, 2.12), frame[faces].all(axis=1)) > 0.8
