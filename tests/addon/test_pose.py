"""Solving in the scene: cameras go where the photos were taken."""

import json

import bpy
import numpy as np
import pytest


def errors(scene, room, module):
    """Rotation (degrees) and centre (m) errors of all photos."""
    bridge, angle = module("addon.bridge.photos"), module("core.geometry.rigid").rotation_angle
    found = []
    for photo, (rotation, translation) in zip(scene.fresco.photos, room.POSES, strict=True):
        view = bridge.read_view(scene, photo)
        off = np.linalg.norm(view.centre + rotation.T @ translation)
        found.append((float(np.degrees(angle(view.rotation @ rotation.T))), off))
    return np.array(found)


def test_cameras_go_where_the_photos_were_taken(imported, room, module):
    assert bpy.ops.fresco.solve_poses() == {"FINISHED"}
    for photo in imported.fresco.photos:
        assert photo.state == "SOLVED", photo.message
        assert 0 <= photo.overlap < 2
        assert 0 < photo.centre_sigma < 0.1
        assert 0 < photo.rotation_sigma < 1
    rotation, centre = errors(imported, room, module).T
    assert rotation.max() < 0.2
    assert centre.max() < 0.015
    bpy.context.view_layer.update()
    for photo, (true_rotation, translation) in zip(imported.fresco.photos, room.POSES, strict=True):
        np.testing.assert_allclose(
            photo.camera.matrix_world.translation, -true_rotation.T @ translation, atol=0.02
        )


def test_only_the_chosen_photo(imported):
    imported.fresco.photo_index = 1
    bpy.ops.fresco.solve_poses(only_active=True)
    assert [photo.state for photo in imported.fresco.photos] == ["UNSOLVED", "SOLVED", "UNSOLVED"]


def test_far_coordinates_give_the_same_poses(scene, tmp_path, folder, room, module, calibrate):
    far = np.array((5_000_000.0, 512_345.5, 120.0))
    room.write_scan(tmp_path / "far.ply", far)
    bpy.ops.fresco.import_scan(filepath=str(tmp_path / "far.ply"))
    for region, name in zip(scene.fresco.regions, room.PANELS, strict=True):
        region.name = name
    bpy.ops.fresco.import_photo_folder(directory=str(folder / "photos"))
    calibrate()
    bpy.ops.fresco.import_mask_folder(directory=str(folder / "masks"))
    bpy.ops.fresco.solve_poses()
    offset = np.array(scene["fresco_offset"])
    bridge = module("addon.bridge.photos")
    for photo, (rotation, translation) in zip(scene.fresco.photos, room.POSES, strict=True):
        centre = bridge.read_view(scene, photo).centre + offset - far
        np.testing.assert_allclose(centre, -rotation.T @ translation, atol=0.015)


def test_a_photo_without_solution_says_why_and_the_others_stand(imported, tmp_path, room):
    import cv2

    photo = imported.fresco.photos[0]
    photo.marks.clear()
    wrong = np.zeros((320, 480), np.uint8)
    wrong[50:53, 60:300] = 255
    (tmp_path / "red panel.png").write_bytes(cv2.imencode(".png", wrong)[1].tobytes())
    imported.fresco.photo_index = 0
    bpy.ops.fresco.import_masks(directory=str(tmp_path), files=[{"name": "red panel.png"}])
    bpy.ops.fresco.solve_poses()
    assert photo.state in {"FAILED", "AMBIGUOUS"}
    assert len(photo.message) > 20
    assert [p.state for p in imported.fresco.photos][1:] == ["SOLVED", "SOLVED"]


def test_what_is_missing_keeps_the_button_grey(scene, folder, room):
    assert not bpy.ops.fresco.solve_poses.poll()
    bpy.ops.fresco.import_scan(filepath=str(folder / "scan.ply"))
    assert not bpy.ops.fresco.solve_poses.poll()
    bpy.ops.fresco.import_photo_folder(directory=str(folder / "photos"))
    bpy.ops.fresco.import_mask_folder(directory=str(folder / "masks"))
    assert not bpy.ops.fresco.solve_poses.poll(), "the cameras are not calibrated"
    with pytest.raises(RuntimeError):
        bpy.ops.fresco.solve_poses()


def test_a_camera_placed_by_hand_can_be_accepted(imported):
    photo = imported.fresco.photos[0]
    imported.fresco.photo_index = 0
    photo.camera.location = (3, 3, 2)
    bpy.ops.fresco.accept_pose()
    assert photo.state == "GIVEN"
    assert bpy.ops.fresco.texture_scan.poll()


def test_candidates_of_an_ambiguous_photo_can_be_looked_at_and_accepted(imported, room, module):
    photo = imported.fresco.photos[0]
    imported.fresco.photo_index = 0
    bpy.ops.fresco.solve_poses(only_active=True)
    solution = json.loads(photo.solution_json)
    other = {**solution["pose"], "translation": [0.0, 0.0, 9.0]}
    solution["pose"]["alternatives"] = [other]
    photo.solution_json, photo.state = json.dumps(solution), "AMBIGUOUS"
    assert not bpy.ops.fresco.texture_scan.poll(), "an ambiguous pose is not used by itself"
    bpy.ops.fresco.next_candidate()
    bridge = module("addon.bridge.photos")
    np.testing.assert_allclose(bridge.read_view(imported, photo).translation, (0, 0, 9))
    bpy.ops.fresco.next_candidate()
    _, translation = room.POSES[0]
    np.testing.assert_allclose(bridge.read_view(imported, photo).translation, translation, atol=0.03)
    bpy.ops.fresco.accept_pose()
    assert photo.state == "GIVEN"
    assert bpy.ops.fresco.texture_scan.poll()
