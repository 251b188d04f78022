import json

import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.cameras.files import (
    camera_from_dict,
    camera_to_dict,
    read_camera,
    read_camera_json,
    write_camera_json,
)
from fresco.core.errors import CameraError, OutputError

PERSPECTIVE = {
    "model": "perspective",
    "width": 600,
    "height": 400,
    "K": [[500, 0, 300], [0, 500, 200], [0, 0, 1]],
}


def test_every_camera_comes_back(any_camera, tmp_path):
    write_camera_json(tmp_path / "camera.json", any_camera)
    copy = read_camera_json(tmp_path / "camera.json")
    assert type(copy) is type(any_camera) and camera_to_dict(copy) == camera_to_dict(any_camera)
    points = np.random.default_rng(1).normal(size=(300, 3))
    np.testing.assert_allclose(copy.project(points), any_camera.project(points), rtol=1e-12)
    assert camera_to_dict(read_camera(tmp_path / "camera.json")) == camera_to_dict(any_camera)


def test_dictionary_is_plain(any_camera):
    table = camera_to_dict(any_camera)
    assert json.loads(json.dumps(table)) == table


def test_defaults_may_be_left_out():
    camera = camera_from_dict(PERSPECTIVE)
    assert isinstance(camera, PerspectiveCamera) and camera.distortion.is_zero


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": "pinhole"}, "not one of perspective"),
        ({"model": None}, "not one of"),
        ({"K": None}, "numbers"),
        ({"K": [["a", 0, 0]]}, "numbers"),
        ({"width": 600.5}, "whole number"),
        ({"width": "wide"}, "expected numbers"),
        ({"distortion": [0.1, np.inf]}, "finite"),
        ({"distortion": {"radial": [0.1], "tau": [0, 0]}}, "'tau' is not one of"),
        ({"distortion": {"tangential": [0.1]}}, "has 2 numbers"),
        ({"xi": 1.0}, "no 'xi'"),
    ],
)
def test_bad_dictionaries_are_explained(change, message):
    with pytest.raises(CameraError, match=message):
        camera_from_dict({**PERSPECTIVE, **change})


def test_missing_entries_are_named():
    for key in ("model", "width", "K"):
        table = {k: v for k, v in PERSPECTIVE.items() if k != key}
        with pytest.raises(CameraError, match=f"photo 7: '{key}' is missing"):
            camera_from_dict(table, "photo 7")


def test_truncated_json_is_explained(tmp_path):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(PERSPECTIVE)[:-10])
    for read in (read_camera_json, read_camera):
        with pytest.raises(CameraError, match="not a complete JSON file"):
            read(path)


def test_file_errors_are_explained(tmp_path):
    with pytest.raises(CameraError, match="cannot be read"):
        read_camera_json(tmp_path / "none.json")
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(CameraError, match="not a text file"):
        read_camera(tmp_path / "binary.json")
    with pytest.raises(OutputError, match="cannot be written"):
        write_camera_json(tmp_path / "binary.json" / "camera.json", camera_from_dict(PERSPECTIVE))


def test_writing_leaves_nothing_else_behind(tmp_path):
    write_camera_json(tmp_path / "camera.json", camera_from_dict(PERSPECTIVE))
    assert [path.name for path in tmp_path.iterdir()] == ["camera.json"]


def test_calibration_of_another_size_is_scaled(tmp_path):
    write_camera_json(tmp_path / "camera.json", camera_from_dict(PERSPECTIVE))
    half = read_camera(tmp_path / "camera.json", size=(300, 200))
    assert (half.width, half.height) == (300, 200)
    np.testing.assert_allclose(half.K, [[250, 0, 149.75], [0, 250, 99.75], [0, 0, 1]])
    with pytest.raises(CameraError, match="another shape than 400 x 600"):
        read_camera(tmp_path / "camera.json", size=(400, 600))
