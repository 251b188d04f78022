from dataclasses import replace

import numpy as np
import pytest
from fresco.core.errors import RegionError
from fresco.core.regions.surface.files import (
    found_again,
    kept_regions,
    read_face_regions,
    write_face_regions,
)

FAR = np.array([3_500_000.0, 5_000_000.0, 250.0])


def wall(step=0.05, shift=0.0):
    """Wall 4 x 3 m at national coordinates, vertices and faces, and the panel (1..3, 1..2) in it."""
    columns, rows = round(4 / step) + 1, round(3 / step) + 1
    u, v = np.meshgrid(np.arange(columns) * step, np.arange(rows) * step)
    vertices = np.stack([u.ravel(), v.ravel(), shift + 0 * u.ravel()], axis=1) + FAR
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate(
        [np.stack([a, a + 1, a + columns], 1), np.stack([a + 1, a + columns + 1, a + columns], 1)]
    )
    return vertices, faces


def panel(vertices, faces):
    middle = vertices[faces].mean(axis=1) - FAR
    return np.flatnonzero((np.abs(middle[:, 0] - 2) < 1) & (np.abs(middle[:, 1] - 1.5) < 0.5))


def kept(vertices, faces):
    return kept_regions(vertices, faces, [("panel", panel(vertices, faces))])[0]


def agreement(found, truth):
    return len(np.intersect1d(found, truth)) / len(np.union1d(found, truth))


def test_the_same_scan_gives_the_same_faces_after_a_file(tmp_path):
    vertices, faces = wall()
    write_face_regions(tmp_path / "regions.npz", [kept(vertices, faces)])
    (back,) = read_face_regions(tmp_path / "regions.npz")
    assert back.name == "panel"
    assert np.array_equal(found_again(back, vertices, faces), panel(vertices, faces))


def test_other_face_numbers_are_found_by_geometry():
    vertices, faces = wall()
    order = np.random.default_rng(0).permutation(len(faces))
    found = found_again(kept(vertices, faces), vertices, faces[order])
    assert np.array_equal(np.sort(order[found]), panel(vertices, faces))


@pytest.mark.parametrize("step", [0.03, 0.08])
def test_another_triangulation_keeps_the_outline(step):
    region = kept(*wall())
    vertices, faces = wall(step, shift=0.002)
    assert agreement(found_again(region, vertices, faces), panel(vertices, faces)) > 0.93


def test_single_precision_and_cropping_change_nothing():
    vertices, faces = wall()
    rounded = (vertices - FAR).astype(np.float32).astype(np.float64) + FAR
    cropped = faces[vertices[faces].mean(axis=1)[:, 0] - FAR[0] > 0.5]
    found = found_again(kept(vertices, faces), rounded, cropped)
    assert agreement(found, panel(rounded, cropped)) == 1


def test_a_wall_behind_is_not_taken_for_the_region():
    vertices, faces = wall()
    with pytest.raises(RegionError, match="0 % of its area"):
        found_again(kept(vertices, faces), *wall(shift=-0.4))
    with pytest.raises(RegionError, match="0 % of its area"):
        found_again(kept(vertices, faces), vertices, faces[:, ::-1])
    with pytest.raises(RegionError, match="Mark it anew"):
        found_again(kept(vertices, faces), vertices + 100.0, faces)


def test_files_and_faces_that_make_no_sense_are_refused(tmp_path):
    vertices, faces = wall()
    with pytest.raises(RegionError, match="empty"):
        kept_regions(vertices, faces, [("panel", [])])
    with pytest.raises(RegionError, match="has not"):
        kept_regions(vertices, faces, [("panel", [len(faces)])])
    (tmp_path / "bad.npz").write_bytes(b"PK nothing")
    for name in ("bad.npz", "missing.npz"):
        with pytest.raises(RegionError, match="can be read"):
            read_face_regions(tmp_path / name)


def test_a_region_of_three_faces_is_kept():
    vertices, faces = wall()
    (region,) = kept_regions(vertices, faces, [("sliver", [5, 6, 7])])
    assert np.array_equal(found_again(region, vertices, faces), [5, 6, 7])
    assert np.array_equal(found_again(replace(region, fingerprint=""), vertices, faces), [5, 6, 7])
