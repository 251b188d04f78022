"""The scripts that make the sample: lens, shapes, masks, EXIF, on cases with a known answer."""

import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy", reason="the sample is modelled with Blender's Python module")
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "sample"))

import chapel
import marking
import painting
import photography
from fresco.core.cameras import PerspectiveCamera
from fresco.core.photos.exif import read_exif
from surfaces import Feature, Shape, Wall


@pytest.mark.parametrize("lens", [photography.WIDE, photography.NORMAL, photography.LONG])
def test_the_lens_agrees_with_the_camera_model(lens):
    rng = np.random.default_rng(1)
    pixels = rng.uniform((0, 0), (photography.WIDTH, photography.HEIGHT), (500, 2))
    rays = np.concatenate([lens.normalised(pixels), np.ones((500, 1))], axis=1)
    camera = PerspectiveCamera(photography.WIDTH, photography.HEIGHT, lens.matrix, lens.distortion)
    assert np.abs(lens.project(rays) - pixels).max() < 1e-5
    assert np.abs(camera.project(rays) - pixels).max() < 1e-5


def test_a_shot_looks_at_its_target():
    for shot in photography.SHOTS:
        assert np.linalg.det(shot.rotation) == pytest.approx(1)
        local = np.array(shot.target) @ shot.rotation.T + shot.translation
        assert local[:2] == pytest.approx((0, 0), abs=1e-9) and local[2] > 1
        assert shot.rotation[1, 2] < -0.9  # down in the photo is down in the world


@pytest.mark.parametrize("arched", [False, True])
def test_outlines_lie_where_the_distance_says(arched):
    shape = Shape(1.0, 0.5, 0.4, 2.0, arched)
    for offset in (-0.1, 0.0, 0.07):
        outline = shape.outline(offset)
        assert np.abs(shape.distance(outline) - offset).max() < 4e-4  # an arc is drawn in chords
        assert len(outline) == len(shape.outline())
    assert shape.distance(np.array([[1.0, 1.0]]))[0] < 0


def test_a_wall_has_its_hole_and_its_creases():
    window = Feature(Shape(1.0, 0.6, 0.3, 1.4), ((-0.1, -0.2), (0.0, 0.0)), hole_below=-0.1)
    wall = Wall(2.0, 2.0, ((0.0, 0.0), (2.0, 0.0)), {"window": window})
    points, faces = wall.mesh(np.random.default_rng(0), 0.05, 0.1)
    a, b, c = (points[faces[:, i]] for i in range(3))
    area = 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert area.sum() == pytest.approx(4.0 - 0.4 * 0.6, abs=1e-6)
    assert wall.relief(points).min() == pytest.approx(-0.2)
    assert len(np.unique(faces)) == len(points)


def test_regions_lie_on_the_walls():
    for name in chapel.REGIONS:
        outline = marking.outline_in_space(name)
        assert (outline[:, 2] >= 0).all()
        assert np.abs(outline[:, 1 if chapel.REGIONS[name].wall == "back" else 0]).max() < 0.08


def test_a_drawn_mask_has_no_half_pixel_in_it():
    square = np.array([[10.0, 20], [50, 20], [50, 40], [10, 40]]) + 0.25
    rows, columns = np.nonzero(marking.mask(square))
    assert (columns.mean(), rows.mean()) == pytest.approx((30.5, 30.5))
    assert len(rows) == 40 * 20


def test_noise_is_seeded_and_canvas_pixels_are_where_they_should():
    first, second = (painting.noise(np.random.default_rng(3), (60, 80), 20) for _ in range(2))
    assert np.array_equal(first, second) and first.shape == (60, 80)
    canvas = painting.Canvas(1.0, 0.5, 0.01, 0, (0, 0, 0))
    canvas.fill([(0.2, 0.1), (0.4, 0.1), (0.4, 0.3), (0.2, 0.3)], (255, 255, 255))
    rows, columns = np.nonzero(canvas.image[..., 0] > 127)
    assert columns.mean() * 0.01 + 0.005 == pytest.approx(0.3, abs=0.006)
    assert 0.5 - (rows.mean() * 0.01 + 0.005) == pytest.approx(0.2, abs=0.006)


def test_exif_is_read_back(tmp_path):
    shot = photography.SHOTS[1]
    photography.write_jpeg(tmp_path / "photo.jpg", np.zeros((40, 60, 3), np.uint8), shot)
    exif = read_exif(tmp_path / "photo.jpg")
    assert (exif.make, exif.model, exif.lens) == ("Fresco", "Sample 1500", "Sample 24 mm")
    assert exif.focal_length == 24.0 and exif.focal_length_35mm == 24
    assert exif.orientation == 1 and exif.aperture == 8
    assert exif.exposure_time == pytest.approx(1 / 42)
