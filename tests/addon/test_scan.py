"""Importing a scan, and what it looks like in the scene."""

import bpy
import numpy as np
import pytest

FAR = (5_000_000.0, 512_345.5, 120.0)


def test_scan_comes_in_with_its_numbers_and_regions(scene, folder, room):
    bpy.ops.fresco.import_scan(filepath=str(folder / "scan.ply"))
    scan = scene.fresco.scan
    _, faces, _ = room.walls()
    assert len(scan.data.polygons) == len(faces)
    assert bpy.context.view_layer.objects.active == scan
    assert not scan.data.validate()
    counts = {region.name: region.face_count for region in scene.fresco.regions}
    assert sorted(counts.values()) == sorted(len(f) for f in room.panel_faces(*room.walls()).values())


def test_grid_coordinates_keep_their_digits(scene, tmp_path, room, module):
    vertices, faces = room.write_scan(tmp_path / "far.ply", FAR)
    bpy.ops.fresco.import_scan(filepath=str(tmp_path / "far.ply"))
    assert max(abs(v.co.x) for v in scene.fresco.scan.data.vertices) < 100
    read = module("addon.bridge.scans").read_scan(scene)
    corners = read.world(read.vertices)[read.faces]
    np.testing.assert_allclose(corners, (vertices + FAR)[faces], rtol=0, atol=2e-5)


def test_offset_survives_saving(scene, tmp_path, room):
    room.write_scan(tmp_path / "far.ply", FAR)
    bpy.ops.fresco.import_scan(filepath=str(tmp_path / "far.ply"))
    before = list(scene["fresco_offset"])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "far.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "far.blend"))
    assert list(bpy.context.scene["fresco_offset"]) == before
    assert before[0] == 5_000_000.0


def test_moved_scan_is_read_where_it_stands(scene, folder, module):
    bpy.ops.fresco.import_scan(filepath=str(folder / "scan.ply"))
    read_scan = module("addon.bridge.scans").read_scan
    before = read_scan(scene).vertices
    scene.fresco.scan.location = (1, 2, 3)
    scene.fresco.scan.rotation_euler = (0, 0, np.pi / 2)
    bpy.context.view_layer.update()
    after = read_scan(scene).vertices
    turned = np.array((1, 2, 3)) + np.stack([-before[:, 1], before[:, 0], before[:, 2]], axis=1)
    np.testing.assert_allclose(after, turned, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("missing.ply", None, "no such file"),
        ("broken.ply", b"ply\nformat ascii 1.0\nelement vertex 3\n", "."),
        ("points.xyz", b"0 0 0\n", "unknown scan format"),
    ],
)
def test_a_bad_file_is_a_sentence_and_changes_nothing(scene, tmp_path, name, content, sentence):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(RuntimeError, match=sentence) as caught:
        bpy.ops.fresco.import_scan(filepath=str(tmp_path / name))
    assert name in str(caught.value)
    assert "Traceback" not in str(caught.value)
    assert scene.fresco.scan is None
    assert not bpy.data.meshes
