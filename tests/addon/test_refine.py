"""Refining in the scene: poses move, tell what they did, and go back."""

import json

import bpy
import numpy as np
import pytest


def offsets(scene, room, module):
    """Distance (m) of all photos from where they were taken."""
    bridge = module("addon.bridge.photos")
    found = [bridge.read_view(scene, photo).centre for photo in scene.fresco.photos]
    truth = [-rotation.T @ translation for rotation, translation in room.POSES]
    return np.linalg.norm(np.subtract(found, truth), axis=1)


def place(scene, room, module, shift, turn=0.0):
    """Put all cameras near their true places and accept them."""
    rigid = module("core.geometry.rigid")
    for number, (rotation, translation) in enumerate(room.POSES):
        photo = scene.fresco.photos[number]
        moved = rigid.exp_so3(np.radians(turn) * np.array([0.5, 1, -0.5])) @ rotation
        centre = -rotation.T @ translation + np.array(shift) * (-1) ** number
        module("addon.bridge.cameras").write_pose(photo.camera, moved, -moved @ centre)
        bpy.context.view_layer.update()
        scene.fresco.photo_index = number
        bpy.ops.fresco.accept_pose()


@pytest.fixture
def placed(imported, room, module):
    place(imported, room, module, (0.015, -0.01, 0.01), 0.1)
    return imported


def test_all_together_comes_nearer_and_can_be_restored(placed, room, module):
    before = offsets(placed, room, module)
    placed.fresco.joint.min_ties = 8
    assert bpy.ops.fresco.refine_jointly() == {"FINISHED"}
    photos = placed.fresco.photos
    moved = [photo for photo in photos if photo.is_refined]
    assert moved, "features tie the photos"
    after = offsets(placed, room, module)
    assert np.median(after) < 0.7 * np.median(before)
    photo = photos[0]
    assert photo.state == "GIVEN" and photo.centre_sigma > 0 and photo.joint_shift >= 0
    bpy.context.view_layer.update()
    view = module("addon.bridge.photos").read_view(placed, photo)
    np.testing.assert_allclose(photo.camera.matrix_world.translation, view.centre, atol=1e-5)
    placed.fresco.photo_index = 0
    assert bpy.ops.fresco.restore_pose() == {"FINISHED"}
    np.testing.assert_allclose(offsets(placed, room, module)[0], before[0], atol=1e-9)
    assert not photo.is_refined and not bpy.ops.fresco.restore_pose.poll()
    np.testing.assert_allclose(offsets(placed, room, module)[1:], after[1:])


def test_held_photos_stay(placed, room, module):
    placed.fresco.joint.min_ties = 8
    placed.fresco.photos[1].hold = True
    before = offsets(placed, room, module)
    bpy.ops.fresco.refine_jointly()
    after = offsets(placed, room, module)
    assert after[1] == before[1] and not placed.fresco.photos[1].is_refined
    assert abs(after[0] - before[0]) > 1e-4
    for photo in placed.fresco.photos:
        photo.hold = True
    with pytest.raises(RuntimeError, match="All poses are held"):
        bpy.ops.fresco.refine_jointly()
    with pytest.raises(RuntimeError, match="its pose is held"):
        bpy.ops.fresco.refine_edges(only_active=True)


def test_one_photo_by_edges_says_what_it_did(placed, room, module):
    placed.fresco.photo_index = 1
    assert bpy.ops.fresco.refine_edges(only_active=True) == {"FINISHED"}
    photo = placed.fresco.photos[1]
    assert [p.refined for p in placed.fresco.photos] == [0, 1, 0]
    (step,) = module("addon.bridge.photos").read_solution(placed, photo).refinements
    assert step.method == "edges" and (step.moved or "kept" in step.note)
    error = bpy.context.window_manager.fresco_job.error
    assert step.moved or error == f"wall 2: {step.note}"


def test_edges_of_photo_and_scan_are_found_for_both_poses(placed, module, room):
    placed.fresco.joint.min_ties = 8
    bpy.ops.fresco.refine_jointly()
    placed.fresco.photo_index = 0
    assert bpy.ops.fresco.show_residuals() == {"FINISHED"}
    overlay = module("addon.overlays.residuals")
    photo = placed.fresco.photos[0]
    found = overlay.edges_of(photo)
    assert len(found.residuals[1].segments) > 100
    vectors = overlay.residual_vectors(found.residuals_at(1.0), 10.0)
    assert len(vectors) > 20 and np.isfinite(vectors).all()
    _, translation = found.pose_at(1.0)
    view = module("addon.bridge.photos").read_view(placed, photo)
    np.testing.assert_allclose(translation, view.translation, atol=1e-12)
    bpy.ops.fresco.restore_pose()
    assert overlay.edges_of(photo) is None, "they belong to another pose now"


def test_what_is_missing_keeps_the_buttons_grey(imported):
    for name in ("refine_edges", "refine_jointly", "restore_pose", "show_residuals"):
        assert not getattr(bpy.ops.fresco, name).poll(), name


def test_refined_poses_are_kept_in_the_file_and_go_into_the_report(placed, tmp_path, module):
    placed.fresco.joint.min_ties = 8
    bpy.ops.fresco.refine_jointly()
    before = placed.fresco.photos[0].pose_json
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "refined.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "refined.blend"))
    scene = bpy.context.scene
    photo = scene.fresco.photos[0]
    assert photo.pose_json == before and "covariance" in json.loads(before)
    solution = module("addon.bridge.photos").read_solution(scene, photo)
    assert solution.given and solution.refinements[0].method == "joint" and solution.sure_pose is not None
    overlay = module("addon.overlays.residuals")
    ties = overlay.ties_of(scene, photo)
    assert len(ties.pixels) >= 8 and np.median(np.linalg.norm(ties.offsets, axis=1)) < 3
    assert np.all((ties.pixels > -1) & (ties.pixels < photo.size))
    scene.fresco.photo_index = 0
    bpy.ops.fresco.restore_pose()
    assert overlay.ties_of(scene, photo) is None, "they belong to another pose now"


def test_a_saved_project_makes_the_same_refinements(placed, tmp_path, module):
    load_project = module("core.project.file.load").load_project
    assert bpy.ops.fresco.save_project(filepath=str(tmp_path / "before.toml")) == {"FINISHED"}
    assert load_project(tmp_path / "before.toml").refine.joint is None
    placed.fresco.joint.min_ties = 8
    bpy.ops.fresco.refine_jointly()
    assert bpy.ops.fresco.save_project(filepath=str(tmp_path / "after.toml")) == {"FINISHED"}
    refine = load_project(tmp_path / "after.toml").refine
    assert refine.joint.min_ties == 8 and refine.edges is None


def test_colours_of_the_scan_reach_core_also_after_its_faces_were_split(imported, room, module, tmp_path):
    from fresco.core.project.stages.textures import TexturedScan

    vertices, faces, _ = room.walls()
    lines = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"property uchar {channel}" for channel in ("red", "green", "blue")]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    colours = np.rint(100 * vertices).astype(int)
    lines += [" ".join(map(str, [*xyz, *rgb])) for xyz, rgb in zip(vertices, colours, strict=True)]
    lines += [f"3 {a} {b} {c}" for a, b, c in faces]
    (tmp_path / "coloured.ply").write_text("\n".join(lines) + "\n")
    bpy.ops.fresco.import_scan(filepath=str(tmp_path / "coloured.ply"))
    scan = module("addon.bridge.scans").read_scan(imported)
    np.testing.assert_allclose(scan.vertex_colors, 100 * scan.vertices, atol=1)
    middles = scan.vertices[scan.faces].mean(axis=1)
    n, k = len(scan.vertices), np.arange(len(scan.faces))
    a, b, c = scan.faces.T
    split = np.concatenate([np.stack([x, y, n + k], axis=1) for x, y in ((a, b), (b, c), (c, a))])
    textured = TexturedScan(
        np.concatenate([scan.vertices, middles]), split.astype(np.int32), np.tile(k, 3), None, ()
    )
    obj = imported.fresco.scan
    module("addon.bridge.texture").refine_mesh(obj, textured)
    module("addon.bridge.colours").carry_over(obj.data, scan, textured)
    again = module("addon.bridge.scans").read_scan(imported)
    assert len(again.vertices) == n + len(k)
    np.testing.assert_allclose(again.vertex_colors, 100 * again.vertices, atol=1.5)
