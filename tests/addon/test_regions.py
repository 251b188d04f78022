"""Regions: faces on the scan and masks in the photos, by the same names."""

import bpy
import cv2
import numpy as np
import pytest


@pytest.fixture
def select(module):
    """Return a function that selects exactly these faces of a scan."""

    def run(scan, numbers):
        chosen = np.zeros(len(scan.data.polygons), dtype=bool)
        chosen[numbers] = True
        module("addon.bridge.meshes").select_faces(scan.data, chosen)

    return run


def test_masks_find_their_photo_and_region(imported, room):
    regions = imported.fresco.regions
    assert [region.name for region in regions] == list(room.PANELS)
    for photo in imported.fresco.photos:
        assert len(photo.marks) == 3
        assert {m.image.filepath.replace("\\", "/").split("/")[-1] for m in photo.marks} == {
            f"{name}.png" for name in room.PANELS
        }


def test_region_from_faces_selected_in_edit_mode(imported, room, select):
    scan = imported.fresco.scan
    wanted = room.panel_faces(*room.walls())["blue tile"]
    select(scan, wanted)
    bpy.context.view_layer.objects.active = scan
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.fresco.region_from_selection(name="tile by hand")
    assert scan.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    region = imported.fresco.active_region
    assert region.name == "tile by hand"
    assert region.face_count == len(wanted)
    values = np.empty(len(scan.data.polygons), dtype=bool)
    scan.data.attributes[region.attribute].data.foreach_get("value", values)
    np.testing.assert_array_equal(np.flatnonzero(values), np.sort(wanted))


def test_faces_of_a_region_survive_editing_and_saving(imported, tmp_path, module, select):
    bridge = module("addon.bridge.regions")
    region = imported.fresco.regions[0]
    scan = imported.fresco.scan
    before = scan.data.polygons[int(np.flatnonzero(bridge.read_faces(imported, region))[0])].center.copy()
    bpy.context.view_layer.objects.active = scan
    select(scan, [0])
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.delete(type="FACE")
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "edited.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "edited.blend"))
    scene = bpy.context.scene
    faces = np.flatnonzero(bridge.read_faces(scene, scene.fresco.regions[0]))
    centres = [scene.fresco.scan.data.polygons[int(k)].center for k in faces]
    assert len(faces) == region_count(scene, 0)
    assert min((centre - before).length for centre in centres) < 1e-6


def region_count(scene, index):
    return scene.fresco.regions[index].face_count


def test_select_and_replace(imported):
    scan, fresco = imported.fresco.scan, imported.fresco
    fresco.region_index = 0
    bpy.ops.fresco.select_region()
    assert scan.mode == "EDIT"
    assert scan.data.total_face_sel == fresco.regions[0].face_count
    bpy.ops.mesh.select_more()
    bpy.ops.fresco.replace_region()
    assert fresco.regions[0].face_count > 60
    bpy.ops.object.mode_set(mode="OBJECT")


def test_nothing_selected_is_a_sentence(imported, select):
    select(imported.fresco.scan, [])
    with pytest.raises(RuntimeError, match="No faces of the scan are selected"):
        bpy.ops.fresco.region_from_selection()


def test_removing_a_region_cleans_up(imported):
    fresco = imported.fresco
    fresco.region_index = 0
    attribute, uid = fresco.regions[0].attribute, fresco.regions[0].uid
    bpy.ops.fresco.remove_region()
    assert attribute not in fresco.scan.data.attributes
    assert all(photo.mark(uid) is None for photo in fresco.photos)


@pytest.mark.parametrize(
    ("mask", "sentence"),
    [
        (np.full((10, 10), 255, np.uint8), "10 x 10"),
        (np.zeros((320, 480), np.uint8), "empty"),
        (np.full((480, 320), 255, np.uint8), "turned"),
    ],
)
def test_a_mask_that_does_not_fit_is_refused(imported, tmp_path, mask, sentence):
    (tmp_path / "window.png").write_bytes(cv2.imencode(".png", mask)[1].tobytes())
    with pytest.raises(RuntimeError, match=sentence):
        bpy.ops.fresco.import_masks(directory=str(tmp_path), files=[{"name": "window.png"}])
    assert imported.fresco.region_named("window") is None


def test_a_folder_without_masks_is_refused(imported, tmp_path):
    with pytest.raises(RuntimeError, match="no masks for these photos"):
        bpy.ops.fresco.import_mask_folder(directory=str(tmp_path))


def test_without_photos_masks_have_to_wait(scene):
    assert not bpy.ops.fresco.import_masks.poll()
    assert not bpy.ops.fresco.region_from_selection.poll()


def test_marks_go_to_core_as_files_or_pixels(imported, module, room, folder):
    bridge = module("addon.bridge.photos")
    photo = imported.fresco.photos[0]
    marks = {mark.name: mark for mark in bridge.read_photo(imported, photo).regions}
    path = folder / "masks" / "wall 1" / "red panel.png"
    assert marks["red panel"].path == path
    mark = next(
        m for m in photo.marks if m.image.name.startswith("red panel") and m.image.filepath == str(path)
    )
    mark.image.pack()
    packed = {m.name: m for m in bridge.read_photo(imported, photo).regions}["red panel"]
    expected = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), 0) > 127
    np.testing.assert_array_equal(packed.read_mask(480, 320), expected)
