import struct

import numpy as np
import pytest
from fresco.core.cameras import EquirectangularCamera, PolynomialCamera
from fresco.core.cameras.exchange import read_colmap, write_colmap
from fresco.core.cameras.files import camera_from_colmap
from fresco.core.errors import CameraError, OutputError
from scipy.spatial.transform import Rotation

CAMERAS = [
    camera_from_colmap("SIMPLE_PINHOLE", 800, 1000, [655.1, 386.1, 511.1]),
    camera_from_colmap("PINHOLE", 800, 1000, [651.1, 655.1, 386.1, 511.1]),
    camera_from_colmap("SIMPLE_RADIAL", 800, 1000, [651.1, 386.1, 511.1, -0.1]),
    camera_from_colmap("RADIAL", 800, 1000, [651.1, 386.1, 511.1, -0.1, 0.03]),
    camera_from_colmap("OPENCV", 800, 1000, [651.1, 655.1, 386.1, 511.1, -0.1, 0.03, 1e-3, -2e-3]),
    camera_from_colmap("OPENCV_FISHEYE", 800, 1000, [651.1, 655.1, 386.1, 511.1, -0.02, 0.003, -0.002, 4e-4]),
    camera_from_colmap("FOV", 800, 1000, [651.1, 655.1, 386.1, 511.1, 0.9]),
    camera_from_colmap("DIVISION", 800, 1000, [651.1, 655.1, 386.1, 511.1, -0.05]),
    camera_from_colmap("EUCM", 800, 1000, [651.1, 655.1, 386.1, 511.1, 0.6, 1.1]),
    EquirectangularCamera(800, 400),
]
CAMERAS_TXT = "# a comment\n1 SIMPLE_RADIAL 800 600 700 400 300 -0.1\n"
IMAGES_TXT = (
    "# a comment\n7 0.5 0.5 -0.5 0.5 1 2 3 1 a folder/IMG 1.jpg\n10.5 11.5 -1\n8 2 0 0 0 0 0 1 1 b.jpg\n\n"
)
POINTS_TXT = "# a comment\n5 1.5 -2.5 3.5 10 20 300 0.7 7 0 8 3\n"


def write_text_model(folder, cameras=CAMERAS_TXT, images=IMAGES_TXT, points=POINTS_TXT):
    for name, text in (("cameras", cameras), ("images", images), ("points3D", points)):
        (folder / f"{name}.txt").write_text(text)
    return folder


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("offset", [(0, 0, 0), (512345.0, 5412345.0, 312.0)])
def test_round_trip(binary, offset, posed, same_projection, tmp_path):
    model = posed(CAMERAS, offset)
    write_colmap(tmp_path / "model", model, binary)
    copy = read_colmap(tmp_path / "model")
    assert [photo.name for photo in copy.cameras] == [photo.name for photo in model.cameras]
    same_projection(model, copy, tolerance=1e-6 if not any(offset) else 2e-5)


def test_photos_share_their_camera(posed, tmp_path):
    write_colmap(tmp_path, posed([CAMERAS[0], CAMERAS[1], CAMERAS[0]]))
    lines = [line for line in (tmp_path / "cameras.txt").read_text().splitlines() if line[0] != "#"]
    assert len(lines) == 2
    copy = read_colmap(tmp_path)
    assert copy.cameras[0].camera is copy.cameras[2].camera


def test_text_by_its_documentation(tmp_path):
    model = read_colmap(write_text_model(tmp_path))
    first, second = model.cameras
    assert (first.name, second.name) == ("a folder/IMG 1.jpg", "b.jpg")
    rotation = Rotation.from_quat([0.5, -0.5, 0.5, 0.5]).as_matrix()
    np.testing.assert_allclose(first.rotation, rotation, atol=1e-15)
    np.testing.assert_allclose(second.rotation, np.eye(3), atol=1e-15)  # the quaternion's length is free
    x, y, z = rotation @ [0.5, -0.2, 4] + [1, 2, 3]
    u, v = x / z, y / z
    factor = 1 - 0.1 * (u * u + v * v)
    np.testing.assert_allclose(
        first.camera.project([[x, y, z]])[0], [700 * u * factor + 399.5, 700 * v * factor + 299.5]
    )
    np.testing.assert_allclose(model.points, [[1.5, -2.5, 3.5]])
    np.testing.assert_array_equal(model.colours, [[10, 20, 255]])


def test_points_may_be_missing(tmp_path):
    write_text_model(tmp_path)
    (tmp_path / "points3D.txt").unlink()
    assert read_colmap(tmp_path).points.shape == (0, 3)


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"cameras": "1 PINHOLE 800 600 500 500 400\n"}, r"cameras\.txt, line 1: .*expected 4 numbers"),
        ({"cameras": "1 WARP 800 600 500\n"}, "'WARP' is not a COLMAP camera model"),
        ({"images": "7 1 0 0 0 1 2 3 1\n\n"}, r"images\.txt, line 1: expected IMAGE_ID"),
        ({"images": "7 1 0 0 0 1 2 3 4 a.jpg\n\n"}, "camera 4 of a.jpg is not in the list"),
        ({"images": "7 0 0 0 0 1 2 3 1 a.jpg\n\n"}, "quaternion of length zero"),
        ({"images": "7 1 0 0 x 1 2 3 1 a.jpg\n\n"}, "expected numbers"),
        ({"points": "5 1.5 -2.5\n"}, "expected 6 numbers, found 2"),
    ],
)
def test_bad_text_is_explained(files, message, tmp_path):
    with pytest.raises(CameraError, match=message):
        read_colmap(write_text_model(tmp_path, **files))


def test_missing_model_is_explained(tmp_path):
    with pytest.raises(CameraError, match="has no COLMAP model"):
        read_colmap(tmp_path)


def test_binary_by_its_documentation(tmp_path):
    write_text_model(tmp_path, cameras="nonsense")  # binary wins
    (tmp_path / "cameras.bin").write_bytes(struct.pack("<QIiQQ4d", 1, 3, 1, 800, 600, 700, 710, 400, 300))
    image = struct.pack("<I7dI", 9, 1, 0, 0, 0, 1, 2, 3, 3) + b"x/y.jpg\0" + struct.pack("<Qddq", 1, 5, 6, -1)
    (tmp_path / "images.bin").write_bytes(struct.pack("<Q", 2) + image + image)
    point = struct.pack("<Q3d3BdQII", 4, 1.5, 2.5, 3.5, 1, 2, 3, 0.5, 1, 9, 0)
    (tmp_path / "points3D.bin").write_bytes(struct.pack("<Q", 2) + point + point)
    model = read_colmap(tmp_path)
    assert [photo.name for photo in model.cameras] == ["x/y.jpg"] * 2
    np.testing.assert_array_equal(model.cameras[1].camera.K, [[700, 0, 399.5], [0, 710, 299.5], [0, 0, 1]])
    np.testing.assert_array_equal(model.cameras[1].translation, [1, 2, 3])
    np.testing.assert_array_equal(model.points, [[1.5, 2.5, 3.5]] * 2)


@pytest.mark.parametrize("part", ["cameras", "images", "points3D"])
def test_truncated_binary_is_explained(part, posed, tmp_path):
    write_colmap(tmp_path, posed(CAMERAS[:2]), binary=True)
    content = (tmp_path / f"{part}.bin").read_bytes()
    for length in (4, 20, len(content) // 2, len(content) - 1):
        (tmp_path / f"{part}.bin").write_bytes(content[:length])
        with pytest.raises(CameraError, match=rf"{part}\.bin is truncated"):
            read_colmap(tmp_path)


def test_unknown_binary_model_is_explained(posed, tmp_path):
    write_colmap(tmp_path, posed(CAMERAS[:1]), binary=True)
    (tmp_path / "cameras.bin").write_bytes(struct.pack("<QIiQQ", 1, 1, 99, 800, 600))
    with pytest.raises(CameraError, match="model number 99"):
        read_colmap(tmp_path)


def test_what_cannot_be_written(posed, tmp_path):
    with pytest.raises(CameraError, match="no model"):
        write_colmap(tmp_path, posed([PolynomialCamera(10, 10, (5, 5), [5.0])]))
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        write_colmap(tmp_path / "file", posed(CAMERAS[:1]))
