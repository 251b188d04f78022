import numpy as np
import pytest
from fresco.core.cameras import (
    CatadioptricCamera,
    Distortion,
    EquirectangularCamera,
    FisheyeCamera,
    PerspectiveCamera,
    PolynomialCamera,
)
from fresco.core.cameras.files import (
    camera_from_colmap,
    camera_from_colmap_line,
    colmap_from_camera,
    colmap_line,
    read_camera,
)
from fresco.core.errors import CameraError

LENSES = {
    "SIMPLE_PINHOLE": [655.1, 386.1, 511.1],
    "PINHOLE": [651.1, 655.1, 386.1, 511.1],
    "SIMPLE_RADIAL": [651.1, 386.1, 511.1, -0.1],
    "RADIAL": [651.1, 386.1, 511.1, -0.1, 0.03],
    "OPENCV": [651.1, 655.1, 386.1, 511.1, -0.1, 0.03, 1e-3, -2e-3],
    "OPENCV_FISHEYE": [651.1, 655.1, 386.1, 511.1, -0.02, 0.003, -0.002, 4e-4],
    "FULL_OPENCV": [651.1, 655.1, 386.1, 511.1, -0.1, 0.03, 1e-3, -2e-3, 0.01, 0.02, 0.02, 0.01],
    "FOV": [651.1, 655.1, 386.1, 511.1, 0.9],
    "SIMPLE_RADIAL_FISHEYE": [651.1, 386.1, 511.1, -0.02],
    "RADIAL_FISHEYE": [651.1, 386.1, 511.1, -0.02, 0.003],
    "THIN_PRISM_FISHEYE": [
        *(651.1, 655.1, 386.1, 511.1),
        *(-0.02, 0.003, 1e-3, -2e-3, -0.002, 4e-4, 1e-3, -5e-4),
    ],
    "RAD_TAN_THIN_PRISM_FISHEYE": [
        *(651.1, 655.1, 386.1, 511.1),
        *(-0.0232, 0.0924, -0.0591, 0.003, 0.0048, -0.0009, 0.0002, 0.0005, -0.0009, -0.0001, 7e-5, -1.7e-4),
    ],
    "SIMPLE_DIVISION": [651.1, 386.1, 511.1, -0.1],
    "DIVISION": [651.1, 655.1, 386.1, 511.1, 0.05],
    "SIMPLE_FISHEYE": [651.1, 386.1, 511.1],
    "FISHEYE": [651.1, 655.1, 386.1, 511.1],
    "EUCM": [651.1, 655.1, 386.1, 511.1, 0.6, 1.1],
}


def brown(u, v, k, p, r2_powers=None):
    r2 = u * u + v * v
    radial = 1 + sum(c * r2**i for i, c in enumerate(k, start=1))
    return (
        u * radial + 2 * p[0] * u * v + p[1] * (r2 + 2 * u * u),
        v * radial + 2 * p[1] * u * v + p[0] * (r2 + 2 * v * v),
    )


def documented(model, params, point):
    """COLMAP's projection, one model at a time, in its pixels (corner of the image at 0, 0)."""
    x, y, z = point
    u, v = x / z, y / z
    r, theta = np.hypot(u, v), np.arctan(np.hypot(u, v))
    tu, tv = u * theta / r, v * theta / r
    one_focal = model.startswith(("SIMPLE", "RADIAL"))
    focals, rest = (params[:1] * 2, params[1:]) if one_focal else (params[:2], params[2:])
    centre, lens = rest[:2], rest[2:]
    if model in ("SIMPLE_PINHOLE", "PINHOLE"):
        plane = u, v
    elif model in ("SIMPLE_RADIAL", "RADIAL"):
        plane = brown(u, v, lens, (0, 0))
    elif model == "OPENCV":
        plane = brown(u, v, lens[:2], lens[2:])
    elif model == "FULL_OPENCV":
        k1, k2, p1, p2, k3, k4, k5, k6 = lens
        r2 = r * r
        ratio = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
        du, dv = brown(u, v, (), (p1, p2))
        plane = du + u * (ratio - 1), dv + v * (ratio - 1)
    elif model in ("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "SIMPLE_FISHEYE", "FISHEYE"):
        plane = brown(tu, tv, lens, (0, 0))
    elif model == "FOV":
        factor = np.arctan(2 * r * np.tan(lens[0] / 2)) / (r * lens[0])
        plane = u * factor, v * factor
    elif model == "THIN_PRISM_FISHEYE":
        k1, k2, p1, p2, k3, k4, sx, sy = lens
        du, dv = brown(tu, tv, (k1, k2, k3, k4), (p1, p2))
        plane = du + sx * theta**2, dv + sy * theta**2
    elif model == "RAD_TAN_THIN_PRISM_FISHEYE":
        *k, p0, p1, s0, s1, s2, s3 = lens
        ru, rv = brown(tu, tv, k, (0, 0))
        r2 = ru * ru + rv * rv
        du = 2 * p1 * ru * rv + p0 * (r2 + 2 * ru * ru) + s0 * r2 + s1 * r2**2
        dv = 2 * p0 * ru * rv + p1 * (r2 + 2 * rv * rv) + s2 * r2 + s3 * r2**2
        plane = ru + du, rv + dv
    elif model in ("SIMPLE_DIVISION", "DIVISION"):
        gain = 2 / (z + np.sqrt(z * z - 4 * (x * x + y * y) * lens[0]))
        plane = x * gain, y * gain
    else:
        alpha, beta = lens
        depth = alpha * np.sqrt(beta * (x * x + y * y) + z * z) + (1 - alpha) * z
        plane = x / depth, y / depth
    return plane[0] * focals[0] + centre[0], plane[1] * focals[1] + centre[1]


@pytest.mark.parametrize("model", LENSES)
def test_projection_is_colmaps(model):
    camera = camera_from_colmap(model, 800, 1000, LENSES[model])
    points = np.random.default_rng(1).uniform([-0.5, -0.5, 0.6], [0.5, 0.5, 3], (50, 3))
    expected = np.array([documented(model, LENSES[model], p) for p in points]) - 0.5
    np.testing.assert_allclose(camera.project(points), expected, atol=1e-9)


@pytest.mark.parametrize("model", LENSES)
def test_round_trip_keeps_model_and_parameters(model):
    camera = camera_from_colmap(model, 800, 1000, LENSES[model])
    name, params = colmap_from_camera(camera)
    assert name == model
    np.testing.assert_allclose(params, LENSES[model], rtol=1e-14)
    identity, copy = camera_from_colmap_line(colmap_line(7, camera))
    points = np.random.default_rng(2).uniform([-0.5, -0.5, 0.6], [0.5, 0.5, 3], (50, 3))
    assert identity == 7
    np.testing.assert_allclose(copy.project(points), camera.project(points), atol=1e-9)


def test_panorama():
    camera = camera_from_colmap("EQUIRECTANGULAR", 800, 400, [800, 400])
    x, y, z = 0.4, -0.3, 0.7
    theta, phi = np.arctan2(x, z), np.arctan2(-y, np.hypot(x, z))
    expected = [(theta / (2 * np.pi) + 0.5) * 800 - 0.5, (0.5 - phi / np.pi) * 400 - 0.5]
    np.testing.assert_allclose(camera.project([[x, y, z]])[0], expected)
    assert colmap_from_camera(camera) == ("EQUIRECTANGULAR", [800, 400])


def test_unequal_focals_need_the_larger_model():
    K = [[650, 0, 400], [0, 660, 300], [0, 0, 1]]
    assert colmap_from_camera(PerspectiveCamera(800, 600, K, [-0.1]))[0] == "OPENCV"
    assert colmap_from_camera(FisheyeCamera(800, 600, K, [-0.1]))[0] == "OPENCV_FISHEYE"
    assert (
        colmap_from_camera(FisheyeCamera(800, 600, K, [0, 0, 0, 0, 0.1]))[0] == "RAD_TAN_THIN_PRISM_FISHEYE"
    )


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        (PerspectiveCamera(800, 600, [[650, 1, 400], [0, 660, 300], [0, 0, 1]]), "skew"),
        (PerspectiveCamera(800, 600, np.eye(3), Distortion(radial=(0, 0, 0, 0.1))), "more radial terms"),
        (PerspectiveCamera(800, 600, np.eye(3), Distortion(prism=(0.1, 0, 0, 0))), "thin-prism"),
        (FisheyeCamera(800, 600, np.eye(3), (0.1,), Distortion(radial=(0.1,))), "all terms"),
        (CatadioptricCamera(800, 600, np.eye(3), 0.9), "no model"),
        (PolynomialCamera(800, 600, (400, 300), [400.0]), "no model"),
        (EquirectangularCamera(800, 300, (800, 400), (0, 50)), "cropped"),
    ],
)
def test_what_colmap_has_no_model_for(camera, message):
    with pytest.raises(CameraError, match=message):
        colmap_from_camera(camera)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1 PINHOLE 800", "expected CAMERA_ID"),
        ("1 PINHOLE 800 600 500 500 400", "expected 4 numbers, found 3"),
        ("1 PINHOLE 800 600 500 500 400 x", "expected numbers"),
        ("1 PINHOLE 800 600 500 500 400 inf", "finite"),
        ("1 MAGIC 800 600 500 500 400 300", "'MAGIC' is not a COLMAP"),
        ("one PINHOLE 800 600 500 500 400 300", "expected numbers"),
        ("1 PINHOLE 800.5 600 500 500 400 300", "whole number"),
        ("1 PINHOLE 800 600 -500 500 400 300", "positive"),
    ],
)
def test_bad_lines_are_explained(line, message):
    with pytest.raises(CameraError, match=message):
        camera_from_colmap_line(line)


def test_file_with_one_camera(tmp_path):
    path = tmp_path / "cameras.txt"
    path.write_text("# Camera list\n3 PINHOLE 800 600 500 500 400 300\n")
    np.testing.assert_allclose(read_camera(path).K, [[500, 0, 399.5], [0, 500, 299.5], [0, 0, 1]])
    path.write_text("3 PINHOLE 800 600 500 500 400 300\n4 PINHOLE 800 600 500 500 400 300\n")
    with pytest.raises(CameraError, match="2 cameras"):
        read_camera(path)
