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


def test_regions_find_their_faces_again_on_the_scan_imported_anew(imported, module, folder):
    bridge = module("addon.bridge.regions")
    fresco = imported.fresco
    names = [region.name for region in fresco.regions]
    counts = [region.face_count for region in fresco.regions]
    bpy.ops.fresco.import_scan(filepath=str(folder / "scan.ply"))
    kept = {name: fresco.region_named(name) for name in names}
    assert [region.face_count for region in kept.values()] == counts
    for region in kept.values():
        assert np.count_nonzero(bridge.read_faces(imported, region)) == region.face_count


def test_an_inverted_mask_is_refused_on_import(imported, tmp_path):
    mask = np.full((320, 480), 255, np.uint8)
    mask[100:200, 100:200] = 0
    (tmp_path / "window.png").write_bytes(cv2.imencode(".png", mask)[1].tobytes())
    with pytest.raises(RuntimeError, match="inverted"):
        bpy.ops.fresco.import_masks(directory=str(tmp_path), files=[{"name": "window.png"}])
    assert imported.fresco.region_named("window") is None


def test_region_from_a_vertex_group_and_from_a_material(imported):
    scan = imported.fresco.scan
    group = scan.vertex_groups.new(name="north wall")
    corners = sorted({v for face in range(40) for v in scan.data.polygons[face].vertices})
    group.add(corners, 1.0, "REPLACE")
    bpy.ops.fresco.region_from_group(source=f"G{group.index}")
    region = imported.fresco.active_region
    whole = sum(set(polygon.vertices) <= set(corners) for polygon in scan.data.polygons)
    assert (region.name, region.face_count) == ("north wall", whole)

    for name in ("plaster", "stone"):
        scan.data.materials.append(bpy.data.materials.new(name))
    scan.data.polygons.foreach_set("material_index", (np.arange(len(scan.data.polygons)) < 25).astype(int))
    bpy.ops.fresco.region_from_group(source="M1")
    assert (imported.fresco.active_region.name, imported.fresco.active_region.face_count) == ("stone", 25)


def test_duplicating_a_region_keeps_faces_marks_and_the_original(imported, module):
    bridge = module("addon.bridge.regions")
    fresco = imported.fresco
    fresco.region_index = 1
    before = bridge.read_faces(imported, fresco.regions[1])
    bpy.ops.fresco.duplicate_region()
    copy = fresco.active_region
    assert copy.name != fresco.regions[1].name and copy.uid != fresco.regions[1].uid
    np.testing.assert_array_equal(bridge.read_faces(imported, copy), before)
    assert all(
        photo.mark(copy.uid).image == photo.mark(fresco.regions[1].uid).image for photo in fresco.photos
    )


@pytest.mark.parametrize(
    ("action", "compare"),
    [
        ("GROW", lambda after, before: after > before),
        ("SHRINK", lambda after, before: after < before),
        ("FILL", lambda after, before: after == before),
        ("SPECKS", lambda after, before: after == before),
        ("INVERT", lambda after, before: after == 3456 - before),
    ],
)
def test_mending_faces(imported, action, compare):
    region = imported.fresco.regions[0]
    imported.fresco.region_index = 0
    before = region.face_count
    bpy.ops.fresco.tidy_faces(action=action)
    assert compare(imported.fresco.regions[0].face_count, before)


def marked_pixels(module, fresco, index=0):
    return module("addon.bridge.images").read_mask_pixels(
        fresco.photos[0].mark(fresco.regions[index].uid).image
    )


def test_mending_an_outline_grows_it_by_the_distance_and_leaves_the_file(imported, module, folder):
    fresco = imported.fresco
    fresco.region_index, fresco.photo_index = 0, 0
    path = folder / "masks" / "wall 1" / f"{fresco.regions[0].name}.png"
    stored, before = path.read_bytes(), marked_pixels(module, fresco)
    imported.fresco_marking.grow = 6
    bpy.ops.fresco.tidy_mark(action="GROW")
    grown = marked_pixels(module, fresco)
    rows = np.flatnonzero(before.any(axis=1))
    grown_rows = np.flatnonzero(grown.any(axis=1))
    assert (rows[0] - grown_rows[0], grown_rows[-1] - rows[-1]) == (6, 6)
    assert grown[before].all() and path.read_bytes() == stored


def test_an_outline_that_would_vanish_or_turn_inside_out_is_kept(imported, module):
    fresco = imported.fresco
    fresco.region_index, fresco.photo_index = 0, 0
    before = marked_pixels(module, fresco)
    imported.fresco_marking.grow = 500
    with pytest.raises(RuntimeError, match="pixels"):
        bpy.ops.fresco.tidy_mark(action="SHRINK")
    with pytest.raises(RuntimeError, match="inverted"):
        bpy.ops.fresco.tidy_mark(action="INVERT")
    np.testing.assert_array_equal(marked_pixels(module, fresco), before)


def test_a_hidden_part_goes_to_the_solver_and_survives_saving(imported, module, tmp_path):
    fresco = imported.fresco
    hidden = np.zeros((320, 480), dtype=bool)
    hidden[40:90, 60:200] = True
    bridge = module("addon.bridge.regions")
    bridge.write_hidden(fresco.photos[0], fresco.regions[0], hidden)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "hidden.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "hidden.blend"))
    fresco = bpy.context.scene.fresco
    photo = module("addon.bridge.photos").read_photo(bpy.context.scene, fresco.photos[0])
    marks = {mark.name: mark for mark in photo.regions}
    np.testing.assert_array_equal(marks[fresco.regions[0].name].hidden, hidden)
    assert marks[fresco.regions[1].name].hidden is None
    surfaces = bridge.surface_source(bpy.context.scene).regions()
    images, _ = module("core.project.stages.poses")._read_regions(photo, surfaces)
    taken = {image.name: image.hidden for image in images}
    np.testing.assert_array_equal(taken[fresco.regions[0].name], hidden)
    fresco.region_index = fresco.photo_index = 0
    bpy.ops.fresco.clear_hidden()
    assert fresco.photos[0].mark(fresco.regions[0].uid).hidden is None
