import tomllib
from pathlib import Path

import numpy as np
import pytest
from fresco.core.cameras import EquirectangularCamera, PerspectiveCamera
from fresco.core.cameras.presets import (
    body_for,
    camera_from_preset,
    nominal_camera,
    preset_names,
    projection_for,
    sensor_width_for,
)
from fresco.core.errors import CameraError

RADII = {
    "perspective": np.tan,
    "stereographic": lambda t: 2 * np.tan(t / 2),
    "equidistant": lambda t: t,
    "equisolid": lambda t: 2 * np.sin(t / 2),
    "orthographic": np.sin,
}


def test_exif_names_find_the_sensor():
    assert sensor_width_for("Canon", "Canon EOS 5D Mark IV") == 36.0
    assert sensor_width_for("NIKON CORPORATION", "nikon d850 ") == 35.9
    assert sensor_width_for("DJI", "FC6310") == 13.2
    assert sensor_width_for("Canon", "Box") is None
    assert body_for("RICOH", "RICOH THETA Z1").is_panoramic
    assert sensor_width_for("RICOH", "RICOH THETA Z1") is None


def test_a_phones_sensor_belongs_to_one_of_its_cameras():
    assert sensor_width_for("Apple", "iPhone 13 Pro", 5.7) == 7.66
    assert sensor_width_for("Apple", "iPhone 13 Pro", 1.57) is None
    assert sensor_width_for("Apple", "iPhone 13 Pro") is None
    with pytest.raises(CameraError, match=r"known for its 5\.7 mm camera, not for 9 mm"):
        camera_from_preset("iPhone 13 Pro", 4032, 3024, 9.0)


@pytest.mark.parametrize(
    ("size", "focal"),
    [
        ((6720, 4480), 4480),
        ((4480, 6720), 4480),
        ((6720, 3780), 4480),
        ((4480, 4480), 4480),
        ((3360, 2240), 2240),
    ],
)
def test_focal_length_in_pixels(size, focal):
    camera = camera_from_preset("Canon EOS 5D Mark IV", *size, 24.0)
    assert isinstance(camera, PerspectiveCamera)
    assert camera.K[0, 0] == camera.K[1, 1] == pytest.approx(focal)
    np.testing.assert_allclose(camera.project([[0, 0, 1]])[0], [size[0] / 2 - 0.5, size[1] / 2 - 0.5])


@pytest.mark.parametrize("projection", RADII)
def test_nominal_projections(projection):
    camera = nominal_camera(4000, 3000, 1000.0, projection)
    angles = np.radians([1, 20, 60, 89])
    points = np.column_stack([np.sin(angles), 0 * angles, np.cos(angles)])
    expected = 1999.5 + 1000 * RADII[projection](angles)
    np.testing.assert_allclose(camera.project(points)[:, 0], expected, atol=1e-5)


def test_equisolid_fisheye_beyond_the_hemisphere():
    camera = nominal_camera(4000, 3000, 1000.0, "Canon EF 8-15mm f/4L Fisheye USM")
    angle = np.radians(110)
    u = camera.project([[np.sin(angle), 0, np.cos(angle)]])[0, 0]
    assert u == pytest.approx(1999.5 + 2000 * np.sin(angle / 2), abs=1e-5)


def test_lenses_by_their_exif_name():
    assert projection_for("EF8-15mm f/4L FISHEYE USM") == "equisolid"
    assert projection_for("EF24-70mm f/2.8L II USM") is None


def test_panoramas():
    assert isinstance(camera_from_preset("RICOH THETA V", 5376, 2688, 1.3), EquirectangularCamera)
    with pytest.raises(CameraError, match="twice as wide"):
        camera_from_preset("RICOH THETA V", 5376, 2000, 1.3)


def test_unknown_names_are_explained():
    with pytest.raises(CameraError, match="'Box' is not in the list"):
        camera_from_preset("Box", 100, 100, 10)
    with pytest.raises(CameraError, match="neither a listed lens"):
        camera_from_preset("Canon EOS R5", 100, 100, 10, "holographic")
    with pytest.raises(CameraError, match="positive number"):
        camera_from_preset("Canon EOS R5", 100, 100, 0)


def test_the_list_makes_sense():
    table = tomllib.loads((Path(__file__).parents[3] / "presets" / "cameras.toml").read_text())
    for group in table["body"]:
        assert ("sensor_mm" in group) != ("projection" in group)
        if "sensor_mm" in group:
            long_side, short_side = group["sensor_mm"]
            assert 3 < short_side < long_side < 60 and 1.2 < long_side / short_side < 1.6
    assert all(group["projection"] in RADII for group in table["lens"])
    names = [(group["make"], model) for group in table["body"] for model in group["models"]]
    assert len(set(names)) == len(names) and len(preset_names()) >= 40
