import copy
import json

import numpy as np
import pytest
from fresco.core.cameras import EquirectangularCamera, FieldOfViewCamera, FisheyeCamera, PerspectiveCamera
from fresco.core.cameras.exchange import read_sfm_data
from fresco.core.errors import CameraError
from scipy.spatial.transform import Rotation

ROTATION = Rotation.from_euler("xyz", [100, 20, -30], degrees=True).as_matrix()
SIZE = {"width": 800, "height": 600}


def wrapped(data, **more):
    return {**more, "ptr_wrapper": {"id": 2147483650, "data": data}}


def openmvg_view(key, name, intrinsic, pose):
    data = {
        "local_path": "",
        "filename": name,
        **SIZE,
        "id_view": key,
        "id_intrinsic": intrinsic,
        "id_pose": pose,
    }
    return {"key": key, "value": wrapped(data, polymorphic_id=1073741824)}


PINHOLE = {"value0": {**SIZE, "focal_length": 700.0, "principal_point": [410.0, 295.0]}}
OPENMVG = {
    "sfm_data_version": "0.3",
    "root_path": "",
    "views": [openmvg_view(i, f"{i}.jpg", i, i) for i in range(5)],
    "intrinsics": [
        {
            "key": 0,
            "value": wrapped(
                {**PINHOLE, "disto_k3": [-0.1, 0.02, -0.01]},
                polymorphic_id=2147483649,
                polymorphic_name="pinhole_radial_k3",
            ),
        },
        {"key": 1, "value": wrapped({**PINHOLE, "disto_k3": [0.0, 0.0, 0.0]}, polymorphic_id=1)},
        {
            "key": 2,
            "value": wrapped(
                {**PINHOLE, "disto_t2": [-0.1, 0.02, -0.01, 0.001, -0.002]},
                polymorphic_id=2147483650,
                polymorphic_name="pinhole_brown_t2",
            ),
        },
        {
            "key": 3,
            "value": wrapped(
                {**PINHOLE, "fisheye": [-0.02, 0.003, -0.002, 4e-4]},
                polymorphic_id=2147483651,
                polymorphic_name="fisheye",
            ),
        },
        {
            "key": 4,
            "value": wrapped(
                {"value0": {"width": 800, "height": 400}},
                polymorphic_id=2147483652,
                polymorphic_name="spherical",
            ),
        },
    ],
    "extrinsics": [
        {"key": i, "value": {"rotation": ROTATION.tolist(), "center": [1.0, 2.0, 3.0]}} for i in range(5)
    ],
    "structure": [{"key": 0, "value": {"X": [1.5, 2.5, 3.5], "observations": []}}],
}


def alicevision(version, intrinsic, **lens):
    return {
        "version": [str(v) for v in version],
        "views": [
            {"viewId": "5", "poseId": "5", "intrinsicId": "9", "path": "C:\\photos\\a.jpg", "width": "800"},
            {"viewId": "6", "poseId": "6", "intrinsicId": "9", "path": "/photos/b.jpg"},
        ],
        "intrinsics": [{"intrinsicId": "9", "width": "800", "height": "600", **intrinsic, **lens}],
        "poses": [
            {
                "poseId": "5",
                "pose": {
                    "transform": {
                        "rotation": [repr(float(v)) for v in ROTATION.T.ravel()],
                        "center": ["1", "2", "3"],
                    },
                    "locked": "0",
                },
            }
        ],
        "structure": [{"landmarkId": "1", "color": ["10", "20", "30"], "X": ["1.5", "2.5", "3.5"]}],
    }


NEW = {"type": "pinhole", "principalPoint": ["10", "-5"], "focalLength": "31.5", "sensorWidth": "36"}


def read(table, tmp_path):
    path = tmp_path / "sfm_data.json"
    path.write_text(json.dumps(table))
    return read_sfm_data(path)


def project(photo, ray):
    """Pixel of a point 3 m away along a ray of the camera frame, through the world."""
    world = photo.centre + ROTATION.T @ (3 * np.asarray(ray))
    return photo.camera.project((photo.rotation @ world + photo.translation)[None])[0]


def brown(x, y, k1=0.0, k2=0.0, k3=0.0, t1=0.0, t2=0.0):
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    return np.array(
        [
            x * radial + t2 * (r2 + 2 * x * x) + 2 * t1 * x * y,
            y * radial + t1 * (r2 + 2 * y * y) + 2 * t2 * x * y,
        ]
    )


def test_openmvg_by_its_formulas(tmp_path):
    model = read(OPENMVG, tmp_path)
    assert [photo.name for photo in model.cameras] == [f"{i}.jpg" for i in range(5)]
    radial, plain, tangential, fisheye, sphere = model.cameras
    x, y, c = 0.2, -0.15, np.array([410.0, 295.0])
    np.testing.assert_allclose(radial.centre, [1, 2, 3])
    np.testing.assert_allclose(project(radial, [x, y, 1]), 700 * brown(x, y, -0.1, 0.02, -0.01) + c)
    np.testing.assert_allclose(project(plain, [x, y, 1]), 700 * np.array([x, y]) + c)
    expected = 700 * brown(x, y, -0.1, 0.02, -0.01, 0.001, -0.002) + c
    np.testing.assert_allclose(project(tangential, [x, y, 1]), expected)
    theta = np.arctan(np.hypot(x, y))
    bent = theta * (1 - 0.02 * theta**2 + 0.003 * theta**4 - 0.002 * theta**6 + 4e-4 * theta**8)
    expected = 700 * np.array([x, y]) * bent / np.hypot(x, y) + c
    np.testing.assert_allclose(project(fisheye, [x, y, 1]), expected)
    assert isinstance(fisheye.camera, FisheyeCamera) and isinstance(sphere.camera, EquirectangularCamera)
    longitude, latitude = np.arctan2(x, 1), np.arctan2(y, np.hypot(x, 1))
    expected = np.array([longitude, latitude]) / (2 * np.pi) * 800 + [400, 200]
    np.testing.assert_allclose(project(sphere, [x, y, 1]), expected)
    np.testing.assert_allclose(model.points, [[1.5, 2.5, 3.5]])


def test_openmvg_photos_without_pose(tmp_path):
    table = copy.deepcopy(OPENMVG)
    table["extrinsics"] = table["extrinsics"][:1]
    model = read(table, tmp_path)
    assert len(model.cameras) == 1 and model.unposed == ("1.jpg", "2.jpg", "3.jpg", "4.jpg")


@pytest.mark.parametrize(
    ("version", "intrinsic", "focal"),
    [
        ((1, 0, 0), {"pxFocalLength": "700", "principalPoint": ["410", "295"]}, (700, 700)),
        ((1, 2, 0), {"pxFocalLength": ["700", "710"], "principalPoint": ["410", "295"]}, (700, 710)),
        ((1, 2, 1), {"pxFocalLength": ["700", "710"], "principalPoint": ["10", "-5"]}, (700, 710)),
        ((1, 2, 3), {**NEW, "pixelRatio": "0.5"}, (700, 1400)),
        ((1, 2, 8), {**NEW, "pixelRatio": "0.5"}, (700, 350)),
    ],
)
def test_alicevisions_versions(version, intrinsic, focal, tmp_path):
    model = read(alicevision(version, {"type": "pinhole", **intrinsic}), tmp_path)
    assert model.unposed == ("b.jpg",)
    photo = model.cameras[0]
    assert photo.name == "a.jpg"
    np.testing.assert_allclose(photo.rotation, ROTATION, atol=1e-12)
    np.testing.assert_allclose(photo.centre, [1, 2, 3])
    np.testing.assert_allclose(project(photo, [0.2, -0.15, 1]), [410 + 0.2 * focal[0], 295 - 0.15 * focal[1]])
    np.testing.assert_allclose(model.points, [[1.5, 2.5, 3.5]])
    np.testing.assert_array_equal(model.colours, [[10, 20, 30]])


@pytest.mark.parametrize(
    ("kind", "lens", "make"),
    [
        ({"type": "radial1"}, [-0.1], PerspectiveCamera),
        ({"type": "radial3"}, [-0.1, 0.02, -0.01], PerspectiveCamera),
        ({"type": "pinhole", "distortionType": "radialk3"}, [-0.1, 0.02, -0.01], PerspectiveCamera),
        ({"type": "brown"}, [-0.1, 0.02, -0.01, 0.001, -0.002], PerspectiveCamera),
        ({"type": "fisheye4"}, [-0.02, 0.003, -0.002, 4e-4], FisheyeCamera),
        ({"type": "fisheye1"}, [0.9], FieldOfViewCamera),
    ],
)
def test_alicevisions_models(kind, lens, make, tmp_path):
    table = alicevision((1, 2, 8), NEW, **kind, distortionParams=[repr(v) for v in lens])
    photo = read(table, tmp_path).cameras[0]
    x, y = 0.2, -0.15
    r = np.hypot(x, y)
    theta = np.arctan(r)
    if make is PerspectiveCamera:
        plane = brown(x, y, *lens)
    elif make is FisheyeCamera:
        plane = np.array([x, y]) / r * theta * (1 + np.polyval([*lens[::-1], 0], theta**2))
    else:
        plane = np.array([x, y]) / r * np.arctan(2 * r * np.tan(lens[0] / 2)) / lens[0]
    assert type(photo.camera) is make
    np.testing.assert_allclose(project(photo, [x, y, 1]), 700 * plane + [410, 295])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"type": "equidistant"}, "'equidistant' is not supported"),
        ({"distortionType": "3deanamorphic4"}, "'3deanamorphic4' is not supported"),
        ({"type": "brown", "distortionParams": ["1", "2"]}, "has 5 distortion parameters, found 2"),
        ({"focalLength": "long"}, "focalLength: expected numbers"),
        ({"principalPoint": ["1"]}, "expected 2 numbers"),
    ],
)
def test_bad_alicevision_is_explained(change, message, tmp_path):
    with pytest.raises(CameraError, match=message):
        read(alicevision((1, 2, 8), {**NEW, **change}), tmp_path)


def test_bad_files_are_explained(tmp_path):
    path = tmp_path / "sfm_data.json"
    path.write_text(json.dumps(OPENMVG)[:-20])
    with pytest.raises(CameraError, match="not a complete JSON file"):
        read_sfm_data(path)
    with pytest.raises(CameraError, match="no views"):
        read({"version": ["1", "0", "0"]}, tmp_path)
    for key, value, message in [
        ("intrinsics", [], "has a pose but no camera"),
        ("extrinsics", {"key": 1}, "'extrinsics' must be a list"),
        ("extrinsics", [{"key": 0, "value": {"center": [0, 0, 0]}}], "'rotation' is missing"),
    ]:
        with pytest.raises(CameraError, match=message):
            read({**OPENMVG, key: value}, tmp_path)
    table = alicevision((1, 2, 8), NEW)
    table["views"][0] |= {"rigId": "3", "isPoseIndependant": "false"}
    with pytest.raises(CameraError, match="belongs to a rig"):
        read(table, tmp_path)
