import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera, PolynomialCamera
from fresco.core.cameras.files import read_camera, read_ocamcalib, write_ocamcalib
from fresco.core.errors import CameraError

DIRECT = (-271.6972, 0.0, -2.741744e-06, 1.840940e-06, -8.024838e-10)
CENTRE, AFFINE = (728.648728, 729.090632), (1.001407, -0.000818, 0.000221)  # row, column; c, d, e
SAMPLE = f"""#polynomial coefficients for the DIRECT mapping function (ocam_model.ss)

5 {" ".join(str(v) for v in DIRECT)}

#polynomial coefficients for the inverse mapping function (ocam_model.invpol)

3 583.439624 470.805865 97.165132

#center: "row" and "column", starting from 0 (C convention)

{CENTRE[0]} {CENTRE[1]}

#affine parameters "c", "d", "e"

{AFFINE[0]} {AFFINE[1]} {AFFINE[2]}

#image size: "height" and "width"

1400 1440
"""


def toolbox_ray(row, column):
    """The toolbox's direct mapping in its own frame: x down the rows, y along the columns."""
    c, d, e = AFFINE
    x, y = np.linalg.solve([[c, d], [e, 1]], [row - CENTRE[0], column - CENTRE[1]])
    ray = np.array([x, y, np.polyval(DIRECT[::-1], np.hypot(x, y))])
    return ray / np.linalg.norm(ray)


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "calib_results.txt"
    path.write_text(SAMPLE)
    return path


def test_rays_are_the_toolboxs_in_our_axes(path):
    camera = read_ocamcalib(path)
    assert (camera.width, camera.height) == (1440, 1400)
    for u, v in [(729, 728.6), (100, 200), (1300.5, 90), (700, 1390)]:
        down, right, back = toolbox_ray(row=v, column=u)
        np.testing.assert_allclose(camera.unproject([[u, v]])[0], [right, down, -back], atol=1e-12)


def test_right_is_right_and_down_is_down(path):
    camera = read_ocamcalib(path)
    u, v = camera.project([[0.3, 0.2, 1.0]])[0]
    assert u > CENTRE[1] and v > CENTRE[0]


def test_round_trip(path, tmp_path):
    camera = read_ocamcalib(path)
    write_ocamcalib(tmp_path / "copy.txt", camera)
    points = np.random.default_rng(1).normal(size=(500, 3))
    for copy in (read_ocamcalib(tmp_path / "copy.txt"), read_camera(tmp_path / "copy.txt")):
        np.testing.assert_allclose(copy.project(points), camera.project(points), atol=1e-8)


def test_written_inverse_polynomial_is_the_toolboxs(path, tmp_path):
    camera = read_ocamcalib(path)
    write_ocamcalib(tmp_path / "copy.txt", camera)
    rows = [line for line in (tmp_path / "copy.txt").read_text().splitlines() if line and line[0] != "#"]
    inverse = np.array(rows[1].split(), dtype=float)[1:]
    c, d, e = AFFINE
    for u, v in [(729.5, 728.6), (100, 200), (1300.5, 90)]:
        x, y, z = toolbox_ray(row=v, column=u)
        rho = np.polyval(inverse[::-1], np.arctan2(z, np.hypot(x, y)))
        x, y = np.array([x, y]) / np.hypot(x, y) * rho
        row, column = x * c + y * d + CENTRE[0], x * e + y + CENTRE[1]
        np.testing.assert_allclose([column, row], [u, v], atol=0.03)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("5 -271", "4 -271", "must count"),
        ("5 -271", "5 abc", "expected numbers"),
        ("5 -271", "5 271", "must be negative"),
        ("1.001407", "nan", "finite"),
        ("1.001407", "-1.001407", "must be positive"),
        (f"{CENTRE[0]} {CENTRE[1]}", f"{CENTRE[0]}", "expected 2 numbers, found 1"),
        ("1400 1440", "", "expected five blocks"),
    ],
)
def test_bad_files_are_explained(old, new, message, path):
    path.write_text(SAMPLE.replace(old, new))
    with pytest.raises(CameraError, match=message):
        read_ocamcalib(path)


def test_only_polynomial_cameras_can_be_written(tmp_path):
    camera = PerspectiveCamera(10, 10, np.eye(3))
    with pytest.raises(CameraError, match="holds a polynomial camera"):
        write_ocamcalib(tmp_path / "camera.txt", camera)
    assert isinstance(PolynomialCamera(10, 10, (5, 5), [3.0]), PolynomialCamera)
