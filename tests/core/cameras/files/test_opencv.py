import cv2
import numpy as np
import pytest
from fresco.core.cameras import (
    CatadioptricCamera,
    Distortion,
    EquirectangularCamera,
    FisheyeCamera,
    PerspectiveCamera,
)
from fresco.core.cameras.files import read_camera, read_opencv, write_opencv
from fresco.core.errors import CameraError

K = np.array([[500.0, 0.0, 303.3], [0, 495.0, 190.8], [0, 0, 1]])
CAMERAS = {
    "none": PerspectiveCamera(600, 400, K),
    "brown": PerspectiveCamera(600, 400, K, (-0.1, 0.02, 1e-3, -2e-3, 0.01)),
    "rational": PerspectiveCamera(600, 400, K, (8.2, 3.1, 2e-4, -1e-4, 0.2, 8.6, 5.2, 0.9)),
    "fisheye": FisheyeCamera(600, 400, K, (-0.02, 0.003, -0.002, 0.0004)),
    "omnidirectional": CatadioptricCamera(600, 400, K, 1.2, (-0.1, 0.02, 1e-3, -2e-3)),
}
SAMPLE = """%YAML:1.0
---
image_width: 600
image_height: 400
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 500., 0., 303.3, 0., 495., 190.8, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.1, 0.02, 0.001, -0.002, 0.01 ]
"""


@pytest.mark.parametrize("suffix", [".yml", ".yaml", ".xml", ".json"])
@pytest.mark.parametrize("name", CAMERAS)
def test_round_trip(name, suffix, tmp_path):
    path, camera = tmp_path / f"camera{suffix}", CAMERAS[name]
    write_opencv(path, camera)
    points = np.random.default_rng(1).uniform([-1, -1, 1], [1, 1, 2], (300, 3))
    for copy in (read_opencv(path), read_camera(path)):
        assert type(copy) is type(camera) and (copy.width, copy.height) == (600, 400)
        np.testing.assert_allclose(copy.project(points), camera.project(points), atol=1e-9)


def test_file_of_opencvs_calibration_program(tmp_path):
    path = tmp_path / "out_camera_data.yml"
    path.write_text(SAMPLE)
    camera = read_opencv(path)
    point = np.array([[0.3, -0.2, 1.4]])
    expected = cv2.projectPoints(
        point, np.zeros(3), np.zeros(3), K, np.array([-0.1, 0.02, 0.001, -0.002, 0.01])
    )
    np.testing.assert_allclose(camera.project(point), expected[0][0], atol=1e-9)


def test_fisheye_by_name_and_plain_lists(tmp_path):
    path = tmp_path / "kalibr.yml"
    path.write_text(
        "%YAML:1.0\n---\nimage_width: 600\nimage_height: 400\ndistortion_model: equidistant\n"
        "K: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
        "   data: [ 500, 0, 303.3, 0, 495, 190.8, 0, 0, 1 ]\n"
        "D: [ -0.02, 0.003, -0.002, 0.0004 ]\n"
    )
    camera = read_opencv(path)
    assert isinstance(camera, FisheyeCamera)
    points = np.random.default_rng(2).normal(size=(100, 3))
    np.testing.assert_allclose(camera.project(points), CAMERAS["fisheye"].project(points))


def test_file_of_ros(tmp_path):
    path = tmp_path / "camera_info.yaml"
    path.write_text(
        "image_width: 600\nimage_height: 400\ncamera_name: left\n"
        "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [500, 0, 303.3, 0, 495, 190.8, 0, 0, 1]\n"
        "distortion_model: plumb_bob\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.1, 0.02, 0.001, -0.002, 0.01]\n"
    )
    points = np.random.default_rng(3).uniform([-1, -1, 1], [1, 1, 2], (30, 3))
    for camera in (read_opencv(path), read_camera(path)):
        np.testing.assert_allclose(camera.project(points), CAMERAS["brown"].project(points))


def test_size_may_be_given(tmp_path):
    path = tmp_path / "camera.yml"
    path.write_text(SAMPLE.replace("image_width: 600\nimage_height: 400\n", ""))
    with pytest.raises(CameraError, match="give the size"):
        read_opencv(path)
    assert read_opencv(path, (600, 400)).width == 600
    assert read_camera(path, (600, 400)).width == 600
    path.write_text(SAMPLE)
    with pytest.raises(CameraError, match="600 x 400 pixels, this one has 500 x 400"):
        read_opencv(path, (500, 400))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("camera_matrix:", "matrix:", "camera matrix .* is missing"),
        ("distortion_coefficients:", "lens:", "distortion coefficients .* is missing"),
        ("303.3", ".Nan", "finite"),
        ("rows: 3\n   cols: 3", "rows: 9\n   cols: 1", "3 x 3"),
        ("[ -0.1, 0.02, 0.001, -0.002, 0.01 ]", "[ a, b, c, d, e ]", "not a complete|finite numbers"),
        ("500.", "-500.", "positive"),
    ],
)
def test_bad_files_are_explained(old, new, message, tmp_path):
    path = tmp_path / "camera.yml"
    path.write_text(SAMPLE.replace(old, new))
    with pytest.raises(CameraError, match=message):
        read_opencv(path)


def test_truncated_file_is_explained(tmp_path):
    path = tmp_path / "camera.yml"
    for length in range(5, len(SAMPLE) - 5, 7):
        path.write_text(SAMPLE[:length])
        with pytest.raises(CameraError, match=r"camera\.yml"):
            read_opencv(path)


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        (EquirectangularCamera(600, 300), "no model"),
        (FisheyeCamera(600, 400, K, (0, 0, 0, 0, 0.1)), r"k1\.\.k4"),
        (FisheyeCamera(600, 400, K, (), Distortion(tangential=(1e-3, 0))), r"k1\.\.k4"),
        (PerspectiveCamera(600, 400, K, Distortion(radial=(0.1, 0, 0, 0.1))), "more radial terms"),
    ],
)
def test_what_opencv_has_no_model_for(camera, message, tmp_path):
    with pytest.raises(CameraError, match=message):
        write_opencv(tmp_path / "camera.yml", camera)
    with pytest.raises(CameraError, match="ends in"):
        write_opencv(tmp_path / "camera.txt", CAMERAS["none"])
