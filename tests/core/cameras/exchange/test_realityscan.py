from dataclasses import replace

import numpy as np
import pytest
from fresco.core.cameras import Distortion, FisheyeCamera, PerspectiveCamera
from fresco.core.cameras.exchange import (
    read_realityscan_csv,
    read_realityscan_xmp,
    write_realityscan_csv,
    write_realityscan_xmp,
)
from fresco.core.errors import CameraError
from scipy.spatial.transform import Rotation

ROTATION = Rotation.from_euler("xyz", [100, 20, -30], degrees=True).as_matrix()
ROWS = " ".join(repr(float(v)) for v in ROTATION.ravel())
SAMPLE = f"""<x:xmpmeta xmlns:x="adobe:ns:meta/">
  <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
    <rdf:Description xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#" xcr:Version="3"
       xcr:PosePrior="locked" xcr:Coordinates="absolute" xcr:DistortionModel="brown4t2"
       xcr:FocalLength35mm="24" xcr:Skew="0" xcr:AspectRatio="1" xcr:PrincipalPointU="0.01"
       xcr:PrincipalPointV="-0.02" xcr:CalibrationPrior="exact">
      <xcr:Rotation>{ROWS}</xcr:Rotation>
      <xcr:Position>2111.5 1607.25 302.125</xcr:Position>
      <xcr:DistortionCoeficients>-0.1 0.02 -0.01 0.002 0.001 -0.003</xcr:DistortionCoeficients>
    </rdf:Description>
  </rdf:RDF>
</x:xmpmeta>
"""
CSV = "#cameras 1\n#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\n"
K = [[2000.0, 0, 1510.0], [0, 2000, 990.0], [0, 0, 1]]
LENS = Distortion(radial=(-0.1, 0.02, -0.01, 0.002), tangential=(1e-3, -2e-3))
CAMERAS = [PerspectiveCamera(3000, 2000, K, LENS), PerspectiveCamera(2000, 3000, K, (-0.1,))]


def landscape(name):
    return 3000, 2000


def documented(x, y):
    """Pixels from the corner of the photo."""
    k1, k2, k3, k4, t1, t2 = -0.1, 0.02, -0.01, 0.002, 0.001, -0.003
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4
    xd = x * radial + t1 * (r2 + 2 * x * x) + 2 * t2 * x * y
    yd = y * radial + t2 * (r2 + 2 * y * y) + 2 * t1 * x * y
    return [(24 / 36 * xd + 0.01) * 3000 + 1500, (24 / 36 * yd - 0.02) * 3000 + 1000]


def test_xmp_by_the_documentation(tmp_path):
    (tmp_path / "IMG_1.xmp").write_text(SAMPLE)
    attribute = SAMPLE.replace(f"<xcr:Rotation>{ROWS}</xcr:Rotation>", "")
    attribute = attribute.replace('xcr:Version="3"', f'xcr:Version="3" xcr:Rotation="{ROWS}"')
    (tmp_path / "IMG_2.xmp").write_text(attribute)
    (tmp_path / "IMG_3.xmp").write_text(SAMPLE.replace("Position", "Place"))
    model = read_realityscan_xmp(tmp_path.glob("*.xmp"), landscape)
    assert [photo.name for photo in model.cameras] == ["IMG_1", "IMG_2"] and model.unposed == ("IMG_3",)
    for photo in model.cameras:
        np.testing.assert_allclose(photo.centre, [2111.5, 1607.25, 302.125])
        world = photo.centre + ROTATION.T @ [0.6, -0.4, 2]
        pixel = photo.camera.project((photo.rotation @ (world - photo.centre))[None])[0]
        np.testing.assert_allclose(pixel, np.array(documented(0.3, -0.2)) - 0.5, atol=1e-8)


@pytest.mark.parametrize("offset", [(0, 0, 0), (512345.0, 5412345.0, 312.0)])
def test_xmp_round_trip(offset, posed, same_projection, tmp_path):
    skewed = PerspectiveCamera(3000, 2000, [[2000.0, 3, 1510.0], [0, 2010, 990.0], [0, 0, 1]])
    model = posed([*CAMERAS, skewed], offset)
    write_realityscan_xmp(tmp_path, model)
    sizes = {f"IMG_{i:04d}": (p.camera.width, p.camera.height) for i, p in enumerate(model.cameras)}
    copy = read_realityscan_xmp(tmp_path.glob("*.xmp"), sizes.__getitem__)
    same_projection(model, copy, tolerance=1e-6 if not any(offset) else 2e-5, points=False)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("capturingreality.com/ns", "example.com", "nothing of RealityScan"),
        ('"absolute"', '"relative"', "relative coordinates"),
        ("brown4t2", "division", "'division' is not supported"),
        ('xcr:FocalLength35mm="24"', "", "FocalLength35mm is missing"),
        ('"24"', '"long"', "FocalLength35mm: expected numbers"),
        (ROWS, "1 2 3", "expected 9 numbers"),
        (ROWS, "1 0 0 0 1 0 0 0 -1", "not a rotation"),
        ("</x:xmpmeta>", "", "not a complete XML file"),
    ],
)
def test_bad_xmp_is_explained(old, new, message, tmp_path):
    (tmp_path / "IMG_1.xmp").write_text(SAMPLE.replace(old, new))
    with pytest.raises(CameraError, match=message):
        read_realityscan_xmp([tmp_path / "IMG_1.xmp"], landscape)


def test_division_without_distortion_is_perspective(tmp_path):
    text = SAMPLE.replace("brown4t2", "division").replace("-0.1 0.02 -0.01 0.002 0.001 -0.003", "0 0 0 0 0 0")
    (tmp_path / "IMG_1.xmp").write_text(text)
    assert read_realityscan_xmp([tmp_path / "IMG_1.xmp"], landscape).cameras[0].camera.distortion.is_zero


@pytest.mark.parametrize(
    ("angles", "forward", "down"),
    [
        ((0, 0, 0), (0, 0, -1), (0, -1, 0)),  # straight down, north at the top
        ((0, 90, 0), (0, 1, 0), (0, 0, -1)),  # level to the north
        ((90, 90, 0), (1, 0, 0), (0, 0, -1)),  # heading turns clockwise: east
        ((0, 0, 90), (-1, 0, 0), (0, -1, 0)),  # roll turns about the north axis
    ],
)
def test_csv_angles(angles, forward, down, tmp_path):
    path = tmp_path / "cameras.csv"
    path.write_text(CSV + f"a.jpg,1,2,3,{','.join(str(a) for a in angles)},24,0,0,0,0,0,0,0,0\n")
    photo = read_realityscan_csv(path, landscape).cameras[0]
    np.testing.assert_allclose(photo.rotation.T @ [0, 0, 1], forward, atol=1e-12)
    np.testing.assert_allclose(photo.rotation.T @ [0, 1, 0], down, atol=1e-12)
    np.testing.assert_allclose(photo.centre, [1, 2, 3])


def test_csv_round_trip(posed, same_projection, tmp_path):
    model = posed(CAMERAS)
    write_realityscan_csv(tmp_path / "cameras.csv", model)
    sizes = {p.name: (p.camera.width, p.camera.height) for p in model.cameras}
    copy = read_realityscan_csv(tmp_path / "cameras.csv", sizes.__getitem__)
    assert [photo.name for photo in copy.cameras] == [photo.name for photo in model.cameras]
    same_projection(model, copy, points=False)


def test_csv_angles_of_a_real_project(tmp_path):
    """Angles and matrix that the program itself gave for one photo (reported in its users' forum)."""
    path = tmp_path / "cameras.csv"
    angles = "163.736597399311,83.4154313461628,174.386496244756"
    path.write_text(CSV + f"a.jpg,1,2,3,{angles},24,0,0,0,0,0,0,0,0\n")
    rotation = read_realityscan_csv(path, landscape).cameras[0].rotation
    rows = [[0.98259407, 0.18542673, -0.01121669], [-0.03211363, 0.11008103, -0.9934037]]
    np.testing.assert_allclose(rotation[:2], rows, atol=1e-8)


@pytest.mark.filterwarnings("error")
def test_a_level_camera_comes_back_from_csv(posed, same_projection, tmp_path):
    """At a pitch of 90 degrees heading and roll cannot be told apart; the rotation is still exact."""
    level = Rotation.from_euler("ZXY", [-20, 90, 0], degrees=True).as_matrix().T
    model = posed([PerspectiveCamera(3000, 2000, K)])
    photo = replace(model.cameras[0], rotation=np.diag([1.0, -1.0, -1.0]) @ level)
    model = replace(model, cameras=(photo,))
    write_realityscan_csv(tmp_path / "cameras.csv", model)
    copy = read_realityscan_csv(tmp_path / "cameras.csv", lambda name: (3000, 2000))
    np.testing.assert_allclose(copy.cameras[0].rotation, photo.rotation, atol=1e-9)


def test_csv_of_few_columns(tmp_path):
    path = tmp_path / "cameras.csv"
    path.write_text("#name,x,y,alt,heading,pitch,roll,f\na.jpg,1,2,3,10,20,30,24\n")
    camera = read_realityscan_csv(path, landscape).cameras[0].camera
    np.testing.assert_allclose(camera.K, [[2000, 0, 1499.5], [0, 2000, 999.5], [0, 0, 1]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "column 'name' is missing"),
        ("#name,x,y,alt\n", "column 'heading' is missing"),
        (CSV + "a.jpg,1,2,3\n", "row 1: expected 16 columns, found 4"),
        (CSV + "a.jpg,1,2,3,x,0,0,24,0,0,0,0,0,0,0,0\n", "row 1: heading: expected numbers"),
        (CSV + "a.jpg,1,2,3,0,0,0,-24,0,0,0,0,0,0,0,0\n", "positive"),
    ],
)
def test_bad_csv_is_explained(text, message, tmp_path):
    path = tmp_path / "cameras.csv"
    path.write_text(text)
    with pytest.raises(CameraError, match=message):
        read_realityscan_csv(path, landscape)


def test_what_cannot_be_written(posed, tmp_path):
    with pytest.raises(CameraError, match="no model for a FisheyeCamera"):
        write_realityscan_xmp(tmp_path, posed([FisheyeCamera(10, 10, np.eye(3))]))
    with pytest.raises(CameraError, match="rational"):
        write_realityscan_xmp(tmp_path, posed([PerspectiveCamera(10, 10, np.eye(3), (0, 0, 0, 0, 0, 0.1))]))
    skewed = PerspectiveCamera(3000, 2000, [[2000.0, 3, 1510.0], [0, 2000, 990.0], [0, 0, 1]])
    with pytest.raises(CameraError, match="no skew"):
        write_realityscan_csv(tmp_path / "cameras.csv", posed([skewed]))
    twins = posed(CAMERAS)
    object.__setattr__(twins.cameras[1], "name", "other/IMG_0000.tif")
    with pytest.raises(CameraError, match="the same"):
        write_realityscan_xmp(tmp_path, twins)
