"""Cameras from and to other programs in the scene."""

import bpy
import numpy as np
import pytest


@pytest.fixture
def solved(imported):
    bpy.ops.fresco.solve_poses()
    return imported


def centres(scene, module):
    bridge = module("addon.bridge.photos")
    return np.array([bridge.read_view(scene, photo).centre for photo in scene.fresco.photos])


def test_cameras_written_come_back_where_they_were(solved, module, tmp_path):
    before = centres(solved, module)
    for file_format in ("colmap", "colmap-binary", "metashape", "realityscan-csv"):
        endings = {"metashape": "cameras.xml", "realityscan-csv": "cameras.csv"}
        target = tmp_path / file_format / endings.get(file_format, "")
        assert bpy.ops.fresco.export_cameras(filepath=str(target), file_format=file_format) == {"FINISHED"}
        bpy.ops.fresco.import_cameras(filepath=str(target))
        np.testing.assert_allclose(centres(solved, module), before, atol=1e-6)
        assert [photo.state for photo in solved.fresco.photos] == ["GIVEN"] * 3
    assert "Imported from" in solved.fresco.photos[0].camera_source


def test_another_world_is_brought_onto_the_scan_by_solved_photos(solved, module, tmp_path):
    exchange = module("core.cameras.exchange")
    bpy.ops.fresco.export_cameras(filepath=str(tmp_path / "same"), file_format="colmap")
    before = centres(solved, module)
    turn = module("core.geometry.rigid").exp_so3(np.array([0.3, 0.2, -1.0]))
    other = exchange.read_reconstruction(tmp_path / "same").transformed(3.0, turn, (5, 6, 7))
    exchange.write_reconstruction(tmp_path / "other", other, "colmap")
    bpy.ops.fresco.import_cameras(filepath=str(tmp_path / "other" / "images.txt"), placing="poses")
    np.testing.assert_allclose(centres(solved, module), before, atol=1e-5)
    assert "Placed on the scan by 3 of 3" in solved.fresco.photos[0].message
    bpy.ops.fresco.import_cameras(filepath=str(tmp_path / "other"), placing="same", lenses=False)
    assert np.linalg.norm(centres(solved, module) - before, axis=1).min() > 1


def test_strange_files_are_told(solved, tmp_path, module):
    exchange = module("core.cameras.exchange")
    bpy.ops.fresco.export_cameras(filepath=str(tmp_path / "same"), file_format="colmap")
    text = (tmp_path / "same" / "images.txt").read_text().replace("wall", "window")
    (tmp_path / "same" / "images.txt").write_text(text)
    before = centres(solved, module)
    with pytest.raises(RuntimeError, match="Bundler needs the principal point in the middle"):
        bpy.ops.fresco.export_cameras(filepath=str(tmp_path / "bundle.out"), file_format="bundler")
    with pytest.raises(RuntimeError, match="none of its photos is in the list; its names are window"):
        bpy.ops.fresco.import_cameras(filepath=str(tmp_path / "same"))
    with pytest.raises(RuntimeError, match="cameras are read from folders"):
        bpy.ops.fresco.import_cameras(filepath=str(tmp_path / "notes.pdf"))
    np.testing.assert_array_equal(centres(solved, module), before)
    assert exchange.WRITE_FORMATS


def test_the_menus_offer_both(extension, module):
    drawn = [f.__name__ for f in bpy.types.TOPBAR_MT_file_import.draw._draw_funcs]
    assert "_draw_import" in drawn
