import numpy as np
import pytest
from fresco.core.cameras import (
    CatadioptricCamera,
    Distortion,
    EquirectangularCamera,
    FisheyeCamera,
    PerspectiveCamera,
)
from fresco.core.cameras.files import read_camera, read_metashape, write_metashape
from fresco.core.errors import CameraError

SAMPLE = """<?xml version="1.0" encoding="UTF-8"?>
<calibration>
  <projection>frame</projection>
  <width>1920</width>
  <height>1080</height>
  <f>1430.15016509976</f>
  <cx>-24.1342060175983</cx>
  <cy>17.5452248329602</cy>
  <b1>1.5</b1>
  <b2>-4.25145544487403</b2>
  <k1>-0.118322055927498</k1>
  <k2>0.293632083518507</k2>
  <k3>-0.1</k3>
  <k4>0.02</k4>
  <p1>0.000330080086304322</p1>
  <p2>0.00182154893322038</p2>
  <date>2017-11-14T23:30:12Z</date>
</calibration>
"""
K = [[1431.7, -4.3, 935.4], [0, 1430.2, 557.0], [0, 0, 1]]
LENS = Distortion(radial=(-0.1, 0.02, -0.01, 0.002), tangential=(1e-3, -2e-3))


def documented(point, fisheye):
    """The manual's formula, pixels from the corner of the image."""
    x, y = point[0] / point[2], point[1] / point[2]
    if fisheye:
        r = np.hypot(x, y)
        x, y = x * np.arctan(r) / r, y * np.arctan(r) / r
    f, cx, cy, b1, b2 = 1430.15016509976, -24.1342060175983, 17.5452248329602, 1.5, -4.25145544487403
    k1, k2, k3, k4 = -0.118322055927498, 0.293632083518507, -0.1, 0.02
    p1, p2 = 0.000330080086304322, 0.00182154893322038
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4
    xd = x * radial + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y
    yd = y * radial + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y
    return 1920 / 2 + cx + xd * f + xd * b1 + yd * b2, 1080 / 2 + cy + yd * f


@pytest.mark.parametrize("projection", ["frame", "fisheye"])
def test_projection_is_metashapes(projection, tmp_path):
    path = tmp_path / "camera.xml"
    path.write_text(SAMPLE.replace("frame", projection))
    points = np.random.default_rng(1).uniform([-0.5, -0.4, 1], [0.5, 0.4, 2], (50, 3))
    expected = np.array([documented(p, projection == "fisheye") for p in points]) - 0.5
    for camera in (read_metashape(path), read_camera(path)):
        np.testing.assert_allclose(camera.project(points), expected, atol=1e-9)


def test_old_files_count_the_principal_point_from_the_corner(tmp_path):
    path = tmp_path / "lens.xml"
    path.write_text(
        "<calibration><projection>frame</projection><width>1000</width><height>800</height>"
        "<fx>900</fx><fy>890</fy><cx>510</cx><cy>395</cy><skew>2</skew><p1>0.001</p1><p2>0.002</p2></calibration>"
    )
    camera = read_metashape(path)
    x, y = 0.2, 0.1
    xd = x + 0.002 * (0.05 + 2 * x * x) + 2 * 0.001 * x * y
    yd = y + 0.001 * (0.05 + 2 * y * y) + 2 * 0.002 * x * y
    np.testing.assert_allclose(
        camera.project([[x, y, 1]])[0], [510 + 900 * xd + 2 * yd - 0.5, 395 + 890 * yd - 0.5]
    )


@pytest.mark.parametrize(
    "camera",
    [
        PerspectiveCamera(1920, 1080, K, LENS),
        PerspectiveCamera(1920, 1080, K),
        FisheyeCamera(1920, 1080, K, (), LENS),
        EquirectangularCamera(1920, 960),
    ],
)
def test_round_trip(camera, tmp_path):
    write_metashape(tmp_path / "camera.xml", camera)
    copy = read_metashape(tmp_path / "camera.xml")
    points = np.random.default_rng(2).uniform([-0.5, -0.4, 1], [0.5, 0.4, 2], (100, 3))
    assert type(copy) is type(camera)
    np.testing.assert_allclose(copy.project(points), camera.project(points), atol=1e-9)


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        (CatadioptricCamera(10, 10, np.eye(3), 1), "no model"),
        (FisheyeCamera(10, 10, np.eye(3), (0.1,)), "no model"),
        (PerspectiveCamera(10, 10, np.eye(3), (0, 0, 0, 0, 0, 0.1)), "rational"),
        (EquirectangularCamera(10, 4, (10, 5)), "cropped"),
    ],
)
def test_what_metashape_has_no_model_for(camera, message, tmp_path):
    with pytest.raises(CameraError, match=message):
        write_metashape(tmp_path / "camera.xml", camera)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<f>1430.15016509976</f>", "", "focal length <f> is missing"),
        ("1430.15016509976", "long", "<f>: expected numbers"),
        ("1430.15016509976", "-3", "positive"),
        ("<width>1920</width>", "", "size of the photo is missing"),
        ("<width>1920", "<width>wide", "width: expected numbers"),
        ("<projection>frame", "<projection>cylindrical", "'cylindrical' are not supported"),
        ("</p2>", "</p2><p3>0.1</p3>", "P3 and P4"),
        ("calibration>", "lens>", "no <calibration>"),
        ("</calibration>", "", "not a complete XML file"),
    ],
)
def test_bad_files_are_explained(old, new, message, tmp_path):
    path = tmp_path / "camera.xml"
    path.write_text(SAMPLE.replace(old, new))
    with pytest.raises(CameraError, match=message):
        read_metashape(path)
