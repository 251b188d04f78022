"""Photos become calibrated cameras with a background that fits the scan."""

import json

import bpy
import cv2
import numpy as np
import pytest


def test_photos_become_cameras(scene, folder, calibrate):
    bpy.ops.fresco.import_photo_folder(directory=str(folder / "photos"))
    photos = scene.fresco.photos
    assert [photo.name for photo in photos] == ["wall 1", "wall 2", "wall 3"]
    assert all(photo.camera_json == "" and "focal length" in photo.camera_source for photo in photos)
    calibrate()
    for photo in photos:
        assert photo.camera.type == "CAMERA"
        assert photo.camera.data.background_images[0].image.size[:] == (480, 320)
        assert photo.image.filepath.endswith(f"{photo.name}.png")
    assert scene.camera == photos[0].camera
    assert (scene.render.resolution_x, scene.render.resolution_y) == (480, 320)


def test_the_files_are_never_touched(scene, folder, calibrate):
    files = sorted((folder / "photos").iterdir())
    before = [(f.read_bytes(), f.stat().st_mtime_ns) for f in files]
    bpy.ops.fresco.import_photo_folder(directory=str(folder / "photos"))
    calibrate()
    assert [(f.read_bytes(), f.stat().st_mtime_ns) for f in files] == before


def test_importing_again_adds_only_what_is_new(scene, folder):
    bpy.ops.fresco.import_photos(directory=str(folder / "photos"), files=[{"name": "wall 1.png"}])
    bpy.ops.fresco.import_photo_folder(directory=str(folder / "photos"))
    assert [photo.name for photo in scene.fresco.photos] == ["wall 1", "wall 2", "wall 3"]
    with pytest.raises(RuntimeError, match="in the list already"):
        bpy.ops.fresco.import_photo_folder(directory=str(folder / "photos"))


def test_a_damaged_photo_is_left_out_and_told(scene, folder, tmp_path):
    whole = (folder / "photos" / "wall 1.png").read_bytes()
    (tmp_path / "a.png").write_bytes(whole)
    (tmp_path / "b.png").write_bytes(whole[: len(whole) // 2])
    bpy.ops.fresco.import_photo_folder(directory=str(tmp_path))
    assert [photo.name for photo in scene.fresco.photos] == ["a"]
    assert "1 of 2 photos left out" in bpy.context.window_manager.fresco_job.error
    assert "b.png" in bpy.context.window_manager.fresco_job.error


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda ops, p: ops.import_photo_folder(directory=str(p / "nowhere")), "there is no such folder"),
        (lambda ops, p: ops.import_photo_folder(directory=str(p)), "there is no photo in this folder"),
        (lambda ops, p: ops.import_photos(directory=str(p), files=[{"name": "x.jpg"}]), "no such photo"),
    ],
)
def test_bad_choices_are_sentences(scene, tmp_path, call, sentence):
    with pytest.raises(RuntimeError, match=sentence):
        call(bpy.ops.fresco, tmp_path)
    assert len(scene.fresco.photos) == 0


def test_background_is_the_photo_without_distortion(scene, folder, calibrate, room, module):
    """A panel's edge is straight in the background and lies where Blender's camera projects it."""
    bpy.ops.fresco.import_photo_folder(directory=str(folder / "photos"))
    calibrate()
    pinhole = module("core.cameras").PerspectiveCamera(*room.SIZE, room.K)
    expected, _ = room.take_photo(pinhole, *room.POSES[0])
    image = scene.fresco.photos[0].camera.data.background_images[0].image
    pixels = np.empty(480 * 320 * 4, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    shown = (pixels.reshape(320, 480, 4)[::-1, :, :3] * 255).astype(np.float32)
    inner = np.s_[20:-20, 20:-20]
    difference = np.abs(cv2.blur(shown, (5, 5)) - cv2.blur(expected.astype(np.float32), (5, 5)))[inner]
    assert np.median(difference) < 2
    assert np.percentile(difference, 99) < 40


def test_a_photo_without_distortion_is_shown_itself(scene, folder):
    bpy.ops.fresco.import_photo_folder(directory=str(folder / "photos"))
    bpy.ops.fresco.set_calibration(source="LENS", focal_mm=39, sensor_mm=36)
    photo = scene.fresco.photos[0]
    assert photo.camera.data.background_images[0].image == photo.image
    assert photo.camera.data.lens == pytest.approx(39)
    assert json.loads(photo.camera_json)["K"][0][0] == pytest.approx(520)
    assert not scene.fresco.photos[1].camera_json


def test_calibration_of_a_listed_body(scene, folder):
    bpy.ops.fresco.import_photo_folder(directory=str(folder / "photos"))
    bpy.ops.fresco.set_calibration(source="BODY", body="Canon EOS 6D", focal_mm=35)
    photo = scene.fresco.photos[0]
    assert json.loads(photo.camera_json)["K"][0][0] == pytest.approx(35 / 35.8 * 480, rel=0.01)
    assert "Canon EOS 6D" in photo.camera_source
    with pytest.raises(RuntimeError, match="Kodak Instamatic"):
        bpy.ops.fresco.set_calibration(source="BODY", body="Kodak Instamatic", focal_mm=35)


def test_calibration_from_a_file(scene, folder, tmp_path, room, module):
    bpy.ops.fresco.import_photo_folder(directory=str(folder / "photos"))
    camera = module("core.cameras").PerspectiveCamera(*room.SIZE, room.K, room.DISTORTION)
    module("core.cameras.files").write_camera_json(tmp_path / "lencse ő.json", camera)
    bpy.ops.fresco.set_calibration(source="FILE", filepath=str(tmp_path / "lencse ő.json"), all_alike=True)
    for photo in scene.fresco.photos:
        assert json.loads(photo.camera_json)["distortion"][0] == pytest.approx(-0.12)
        assert photo.camera_source == "Calibration file lencse ő.json"


def test_choosing_a_photo_makes_it_the_scenes_camera(imported):
    imported.fresco.photo_index = 2
    assert imported.camera == imported.fresco.photos[2].camera
    bpy.ops.fresco.look_through(index=1)
    assert imported.camera == imported.fresco.photos[1].camera


def test_removing_a_photo_removes_its_camera(imported, folder):
    name = imported.fresco.photos[0].camera.name
    imported.fresco.photo_index = 0
    bpy.ops.fresco.remove_photo()
    assert [photo.name for photo in imported.fresco.photos] == ["wall 2", "wall 3"]
    assert name not in bpy.data.objects
    assert (folder / "photos" / "wall 1.png").exists()


def test_calibration_and_pose_survive_saving(imported, room, tmp_path, module):
    bridge = module("addon.bridge.photos")
    for photo, (rotation, translation) in zip(imported.fresco.photos, room.POSES, strict=True):
        bridge.write_pose(imported, photo, rotation, translation, np.eye(6))
    path = tmp_path / "mentés 1.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    scene = bpy.context.scene
    for photo, (rotation, translation) in zip(scene.fresco.photos, room.POSES, strict=True):
        view = bridge.read_view(scene, photo)
        np.testing.assert_array_equal(view.rotation, rotation)
        np.testing.assert_array_equal(view.translation, translation)
        np.testing.assert_array_equal(view.covariance, np.eye(6))
        np.testing.assert_allclose(view.camera.K, room.K, rtol=1e-6)
        np.testing.assert_allclose(view.camera.distortion.opencv[:4], room.DISTORTION, rtol=1e-6)
        assert photo.camera.data.background_images[0].image.packed_file is not None
        assert photo.camera.data.background_images[0].image.size[:] == (480, 320)


def test_a_camera_moved_by_hand_counts_where_it_stands(imported, room, module):
    bridge = module("addon.bridge.photos")
    photo = imported.fresco.photos[0]
    rotation, translation = room.POSES[0]
    bridge.write_pose(imported, photo, rotation, translation)
    bpy.context.view_layer.update()
    assert not bridge.is_moved(imported, photo)
    photo.camera.location.z += 0.25
    bpy.context.view_layer.update()
    assert bridge.is_moved(imported, photo)
    view = bridge.read_view(imported, photo)
    np.testing.assert_allclose(view.centre, -rotation.T @ translation + (0, 0, 0.25), atol=1e-6)


def test_a_camera_deleted_from_the_scene_comes_back(imported):
    photo = imported.fresco.photos[1]
    bpy.ops.object.select_all(action="DESELECT")
    photo.camera.select_set(True)
    bpy.ops.object.delete()
    assert "wall 2" not in imported.objects
    bpy.ops.fresco.look_through(index=1)
    assert imported.camera.name == "wall 2" and "wall 2" in imported.objects
    bpy.ops.fresco.solve_poses()
    assert photo.state == "SOLVED"
