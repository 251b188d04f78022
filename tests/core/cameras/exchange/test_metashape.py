import numpy as np
import pytest
from fresco.core.cameras import (
    CatadioptricCamera,
    Distortion,
    EquirectangularCamera,
    FisheyeCamera,
    PerspectiveCamera,
)
from fresco.core.cameras.exchange import read_metashape_cameras, write_metashape_cameras
from fresco.core.errors import CameraError
from scipy.spatial.transform import Rotation

TURN, TILT = (
    Rotation.from_euler("z", 90, degrees=True).as_matrix(),
    Rotation.from_euler("x", 90, degrees=True).as_matrix(),
)


def words(matrix):
    return " ".join(repr(float(v)) for v in np.ravel(matrix))


def camera_matrix(rotation, centre):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, centre
    return words(matrix)


SAMPLE = f"""<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1" enabled="true">
  <sensors next_id="1"><sensor id="0" label="X" type="frame">
    <resolution width="800" height="600"/>
    <calibration type="frame" class="initial"><resolution width="800" height="600"/><f>1</f></calibration>
    <calibration type="frame" class="adjusted"><resolution width="800" height="600"/>
      <f>700</f><cx>10</cx><cy>-5</cy><k1>-0.1</k1><p1>0.001</p1></calibration>
  </sensor></sensors>
  <components next_id="2" active_id="0"><component id="0" label="1"><transform>
    <rotation locked="true">{words(TURN)}</rotation><translation locked="true">100 200 300</translation>
    <scale locked="true">2.5</scale></transform></component></components>
  <cameras next_id="3" next_group_id="1">
    <camera id="0" sensor_id="0" component_id="0" label="IMG_1">
      <transform>{camera_matrix(TILT, [1, 2, 3])}</transform></camera>
    <group id="0" label="G"><camera id="1" sensor_id="0" component_id="0" label="IMG_2">
      <transform>{camera_matrix(np.eye(3), [0, 0, 0])}</transform></camera></group>
    <camera id="2" sensor_id="0" label="IMG_3"/>
  </cameras></chunk></document>
"""


def test_projection_by_the_documentation(tmp_path):
    path = tmp_path / "cameras.xml"
    path.write_text(SAMPLE)
    model = read_metashape_cameras(path)
    assert [photo.name for photo in model.cameras] == ["IMG_1", "IMG_2"] and model.unposed == ("IMG_3",)
    photo = model.cameras[0]
    np.testing.assert_allclose(photo.centre, 2.5 * TURN @ [1, 2, 3] + [100, 200, 300])
    in_camera = np.array([0.3, -0.2, 2.0])
    world = 2.5 * TURN @ (TILT @ in_camera + [1, 2, 3]) + [100, 200, 300]
    x, y = 0.15, -0.1
    r2 = x * x + y * y
    xd = x * (1 - 0.1 * r2) + 0.001 * (r2 + 2 * x * x)
    yd = y * (1 - 0.1 * r2) + 2 * 0.001 * x * y
    expected = [800 / 2 + 10 + 700 * xd - 0.5, 600 / 2 - 5 + 700 * yd - 0.5]
    pixel = photo.camera.project((photo.rotation @ world + photo.translation)[None])[0]
    np.testing.assert_allclose(pixel, expected, atol=1e-9)


def test_old_files_have_the_transform_at_the_chunk(tmp_path):
    path = tmp_path / "cameras.xml"
    start, end = SAMPLE.index("<components"), SAMPLE.index("</components>") + len("</components>")
    transform = SAMPLE[SAMPLE.index("<transform>", start) : SAMPLE.index("</component>", start)]
    path.write_text((SAMPLE[:start] + SAMPLE[end:]).replace("</cameras>", "</cameras>" + transform))
    np.testing.assert_allclose(read_metashape_cameras(path).cameras[1].centre, [100, 200, 300])


@pytest.mark.parametrize("offset", [(0, 0, 0), (512345.0, 5412345.0, 312.0)])
def test_round_trip(offset, posed, same_projection, tmp_path):
    K = [[705.0, 0.3, 411], [0, 700, 295], [0, 0, 1]]
    lens = Distortion(radial=(-0.1, 0.02, -0.01, 0.002), tangential=(1e-3, -2e-3))
    frame = PerspectiveCamera(800, 600, K, lens)
    cameras = [frame, FisheyeCamera(800, 600, K, (), lens), EquirectangularCamera(800, 400), frame]
    model = posed(cameras, offset)
    write_metashape_cameras(tmp_path / "cameras.xml", model)
    copy = read_metashape_cameras(tmp_path / "cameras.xml")
    assert [photo.name for photo in copy.cameras] == [photo.name for photo in model.cameras]
    same_projection(model, copy, tolerance=1e-6 if not any(offset) else 2e-5, points=False)
    assert copy.cameras[0].camera is copy.cameras[3].camera


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("</chunk>", "</chunk><chunk/>", "2 chunks"),
        ('sensor id="0"', 'sensor id="5"', "its sensor is not in the file"),
        ("<f>700</f>", "", "focal length"),
        ("<f>700</f>", "<f>long</f>", "expected numbers"),
        ('label="X" type="frame"', 'label="X" type="rpc"', "'rpc' are not supported"),
        (words(TURN), words(2 * TURN), "not a rotation"),
        (words(TURN), "1 0 0", "expected 9 numbers"),
        (camera_matrix(TILT, [1, 2, 3]), "1 2 3", "expected 16 numbers"),
        ("</document>", "", "not a complete XML file"),
    ],
)
def test_bad_files_are_explained(old, new, message, tmp_path):
    path = tmp_path / "cameras.xml"
    assert old in SAMPLE
    path.write_text(SAMPLE.replace(old, new))
    with pytest.raises(CameraError, match=message):
        read_metashape_cameras(path)


def test_what_cannot_be_written(posed, tmp_path):
    with pytest.raises(CameraError, match="no model"):
        write_metashape_cameras(tmp_path / "cameras.xml", posed([CatadioptricCamera(10, 10, np.eye(3), 1)]))
