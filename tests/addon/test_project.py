"""A project file in the window gives the same scene as by hand, and the same result as without a window."""

import bpy
import numpy as np
import pytest

PROJECT = """
fresco = 1
[scan]
path = "scan.ply"
[[camera]]
K = [[520.0, 0.0, 236.5], [0.0, 520.0, 163.0], [0.0, 0.0, 1.0]]
distortion = [-0.12, 0.03, 0.001, -0.0005]
[[region]]
name = "red panel"
face_set = "region 1"
[[region]]
name = "green panel"
face_set = "region 2"
[[region]]
name = "blue tile"
face_set = "region 3"
[[photo]]
path = "photos/*.png"
regions = "masks/{photo}/{region}.png"
[[photo]]
path = "photos/wall 3.png"
use = "pose"
[texture]
max_angle = 80.0
[output]
folder = "eredmény"
blend = false
"""


@pytest.fixture
def project(folder):
    path = folder / "templom.toml"
    path.write_text(PROJECT, encoding="utf-8")
    return path


def test_project_fills_the_scene(scene, project, room, folder):
    assert bpy.ops.fresco.open_project(filepath=str(project)) == {"FINISHED"}
    fresco = scene.fresco
    assert fresco.scan.name == "scan"
    assert [region.name for region in fresco.regions] == list(room.PANELS)
    assert all(region.face_count > 0 for region in fresco.regions)
    assert [photo.name for photo in fresco.photos] == ["wall 1", "wall 2", "wall 3"]
    assert [photo.use_texture for photo in fresco.photos] == [True, True, False]
    assert all(len(photo.marks) == 3 for photo in fresco.photos)
    assert fresco.texture.max_angle == 80
    assert fresco.export.folder == str(folder / "eredmény") and fresco.export.name == "templom"
    assert not fresco.export.write_blend and fresco.export.write_glb


def test_window_and_batch_give_the_same(scene, project, module):
    core = module("core.project")
    batch = core.run_project(core.load_project(project))
    bpy.ops.fresco.open_project(filepath=str(project))
    bpy.ops.fresco.solve_poses()
    bpy.ops.fresco.texture_scan()
    bridge, texture = module("addon.bridge.photos"), module("addon.bridge.texture")
    for photo, solved in zip(scene.fresco.photos, batch.poses, strict=True):
        view = bridge.read_view(scene, photo)
        # Blender keeps vertices in single precision: micrometres here.
        np.testing.assert_allclose(view.rotation, solved.pose.rotation, atol=1e-5)
        np.testing.assert_allclose(view.centre, solved.pose.centre, atol=1e-5)
    window = texture.read_texture(scene)
    assert [view.name for view in window.views] == ["wall 1", "wall 2"]
    same = window.selection.view == batch.textured.selection.view
    assert same.mean() > 0.999
    np.testing.assert_allclose(window.selection.uv[same], batch.textured.selection.uv[same], atol=0.02)


def test_opening_another_project_replaces_the_first(scene, project):
    bpy.ops.fresco.open_project(filepath=str(project))
    bpy.ops.fresco.open_project(filepath=str(project))
    assert len(scene.fresco.photos) == 3 and len(scene.fresco.regions) == 3
    assert len([obj for obj in scene.objects if obj.type == "CAMERA"]) == 3
    assert [obj.name for obj in scene.objects if obj.type == "MESH"] == ["scan"]


def test_a_wrong_project_changes_nothing(imported, project):
    project.write_text(PROJECT.replace("fresco = 1", "fresco = 1\nscann = 2"), encoding="utf-8")
    with pytest.raises(RuntimeError, match="scann"):
        bpy.ops.fresco.open_project(filepath=str(project))
    assert len(imported.fresco.photos) == 3
    assert "templom.toml" in bpy.context.window_manager.fresco_job.error
