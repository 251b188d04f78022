import numpy as np
import pytest
from fresco.core.cameras import EquirectangularCamera, PerspectiveCamera
from fresco.core.cameras.exchange import read_bundler, read_bundler_list, read_nvm, write_bundler
from fresco.core.errors import CameraError
from scipy.spatial.transform import Rotation

ROTATION = Rotation.from_euler("xyz", [160, 20, -30], degrees=True).as_matrix()
ROWS = "\n".join(" ".join(repr(float(v)) for v in row) for row in ROTATION)
SAMPLE = f"""# Bundle file v0.3
2 1
700 -0.1 0.02
{ROWS}
0.5 -0.25 -4
0 0 0
0 0 0
0 0 0
0 0 0
0 0 0
1.5 2.5 3.5
10 20 30
2 0 17 10.5 -20.5 1 3 1.5 2.5
"""
W, X, Y, Z = np.roll(Rotation.from_matrix(ROTATION).as_quat(), 1)
NVM = f"""NVM_V3

2
a.jpg 700 {W!r} {X!r} {Y!r} {Z!r} 1 2 3 -0.1 0
b.jpg 700 1 0 0 0 0 0 0 0 0

1
1.5 2.5 3.5 10 20 30 2 0 17 10.5 -20.5 1 3 1.5 2.5

0
"""


def size_of(name):
    return 800, 600


def test_bundler_by_its_documentation(tmp_path):
    path = tmp_path / "bundle.out"
    path.write_text(SAMPLE)
    model = read_bundler(path, ["a.jpg", "b.jpg"], size_of)
    assert [photo.name for photo in model.cameras] == ["a.jpg"] and model.unposed == ("b.jpg",)
    world = np.array([0.3, 0.2, 1.5])
    p = ROTATION @ world + [0.5, -0.25, -4]
    assert p[2] < 0  # in front of a camera that looks along -z
    x, y = -p[:2] / p[2]
    r2 = x * x + y * y
    pixel = 700 * (1 - 0.1 * r2 + 0.02 * r2**2) * np.array([x, y])  # from the middle, y up
    photo = model.cameras[0]
    np.testing.assert_allclose(
        photo.camera.project((photo.rotation @ world + photo.translation)[None])[0],
        [400 + pixel[0] - 0.5, 300 - pixel[1] - 0.5],
        atol=1e-9,
    )
    np.testing.assert_allclose(model.points, [[1.5, 2.5, 3.5]])
    np.testing.assert_array_equal(model.colours, [[10, 20, 30]])


@pytest.mark.parametrize("offset", [(0, 0, 0), (512345.0, 5412345.0, 312.0)])
def test_round_trip(offset, posed, same_projection, tmp_path):
    K = [[700.0, 0, 399.5], [0, 700, 299.5], [0, 0, 1]]
    model = posed([PerspectiveCamera(800, 600, K, (-0.1, 0.02)), PerspectiveCamera(800, 600, K)], offset)
    write_bundler(tmp_path / "bundle.out", tmp_path / "list.txt", model)
    names = read_bundler_list(tmp_path / "list.txt")
    same_projection(
        model,
        read_bundler(tmp_path / "bundle.out", names, size_of),
        tolerance=1e-6 if not any(offset) else 2e-5,
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("2 1\n700", "3 1\n700", "3 cameras, its list of photos 2"),
        ("700 -0.1", "long -0.1", "a.jpg: expected numbers"),
        ("10.5 -20.5 1 3 1.5 2.5", "", "truncated"),
        (ROWS, "1 0 0 0 1 0 0 0 -1", "not a rotation"),
        ("700 -0.1", "-700 -0.1", "positive"),
    ],
)
def test_bad_bundler_is_explained(old, new, message, tmp_path):
    path = tmp_path / "bundle.out"
    path.write_text(SAMPLE.replace(old, new))
    with pytest.raises(CameraError, match=message):
        read_bundler(path, ["a.jpg", "b.jpg"], size_of)


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        (EquirectangularCamera(800, 400), "no model"),
        (PerspectiveCamera(800, 600, [[700, 0, 399.5], [0, 710, 299.5], [0, 0, 1]]), "one focal length"),
        (PerspectiveCamera(800, 600, [[700, 0, 410], [0, 700, 299.5], [0, 0, 1]]), "principal point"),
        (
            PerspectiveCamera(800, 600, [[700, 0, 399.5], [0, 700, 299.5], [0, 0, 1]], (0, 0, 1e-3)),
            "two radial",
        ),
    ],
)
def test_what_bundler_cannot_hold(camera, message, posed, tmp_path):
    with pytest.raises(CameraError, match=message):
        write_bundler(tmp_path / "bundle.out", tmp_path / "list.txt", posed([camera]))


def test_nvm_by_its_documentation(tmp_path):
    path = tmp_path / "scene.nvm"
    path.write_text(NVM)
    model = read_nvm(path, size_of)
    assert [photo.name for photo in model.cameras] == ["a.jpg", "b.jpg"]
    photo = model.cameras[0]
    np.testing.assert_allclose(photo.centre, [1, 2, 3])
    measured = np.array([120.0, -80])  # pixels from the middle
    undistorted = measured / 700 * (1 - 0.1 * (measured**2).sum() / 700**2)
    world = photo.centre + ROTATION.T @ [*undistorted * 3, 3]
    pixel = photo.camera.project((photo.rotation @ world + photo.translation)[None])[0]
    np.testing.assert_allclose(pixel, measured + np.array([399.5, 299.5]), atol=1e-9)
    np.testing.assert_allclose(model.points, [[1.5, 2.5, 3.5]])


def test_nvm_with_fixed_calibration(tmp_path):
    path = tmp_path / "scene.nvm"
    path.write_text(NVM.replace("NVM_V3\n", "NVM_V3 FixedK 710 405 720 295\n").replace("-0.1 0", "0 0"))
    K = read_nvm(path, size_of).cameras[0].camera.K
    np.testing.assert_allclose(K, [[710, 0, 404.5], [0, 720, 294.5], [0, 0, 1]])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("NVM_V3", "NVM_V2", "not an NVM_V3"),
        ("NVM_V3\n", "NVM_V3 FixedK 710 405 720 295\n", "unequal focal lengths"),
        ("a.jpg 700", "a.jpg long", "expected numbers"),
        ("1 0 0 0 0 0 0 0 0", "0 0 0 0 0 0 0 0 0", "length zero"),
        ("1.5 2.5 3.5 10", "", "truncated|expected"),
        (NVM[NVM.index("b.jpg") :], "", "truncated"),
    ],
)
def test_bad_nvm_is_explained(old, new, message, tmp_path):
    path = tmp_path / "scene.nvm"
    path.write_text(NVM.replace(old, new))
    with pytest.raises(CameraError, match=message):
        read_nvm(path, size_of)
