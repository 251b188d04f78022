"""A project saved from the window is the same project when it is opened again, in the window and without."""

import bpy
import numpy as np
import pytest

OPENING = np.array([[0.3, 0.0, 0.4], [0.6, 0.0, 0.4], [0.6, 0.0, 0.6], [0.3, 0.0, 0.6]])


@pytest.fixture
def marked(imported, module):
    """Return the scene with a hidden part, an opening, a region in photos only, and a point."""
    fresco, bridge = imported.fresco, module("addon.bridge.regions")
    photo = fresco.photos[0]
    hidden = np.zeros((320, 480), dtype=bool)
    hidden[100:140, 200:260] = True
    bridge.write_hidden(photo, fresco.regions[0], hidden)
    opening = module("core.regions.surface.opening").opening_region(OPENING, "niche")
    bridge.write_opening(imported, bridge.add_region(imported, "niche"), opening)
    mask = np.zeros((320, 480), dtype=bool)
    mask[20:60, 30:90] = True
    mark = module("core.photos").RegionMark("not yet: on the scan", mask=mask)
    bridge.write_mark(photo, bridge.add_region(imported, mark.name), mark, (480, 320))
    module("addon.bridge.points").write_point(imported, "P1", (1.0, 2.0, 0.5))
    module("addon.bridge.points").write_pick(photo, "P1", (101.5, 77.25))
    fresco.photos[1].use_texture, fresco.photos[2].hold = False, True
    fresco.texture.max_angle = 70.0
    return imported


def state(scene, module):
    """Return what a project has to keep, as plain values."""
    bridge, photos = module("addon.bridge.regions"), module("addon.bridge.photos")
    fresco = scene.fresco
    faces = {r.name: np.flatnonzero(bridge.read_faces(scene, r)).tolist() for r in fresco.regions}
    surfaces = bridge.surface_source(scene).regions()
    found = {"faces": faces, "corners": {n: s.vertices.round(6).tolist() for n, s in surfaces.items()}}
    for photo in fresco.photos:
        core = photos.read_photo(scene, photo)
        for mark in core.regions:
            hidden = mark.read_hidden(480, 320)
            found[photo.name, mark.name] = (
                int(mark.read_mask(480, 320).sum()),
                0 if hidden is None else int(hidden.sum()),
            )
        picks = module("addon.bridge.points").read_picks(photo)
        found[photo.name] = core.camera.K.tolist(), photo.use_texture, photo.hold, picks
    return found | {"angle": fresco.texture.max_angle, "points": [tuple(p.place) for p in fresco.points]}


def test_what_was_saved_is_opened_again(marked, module, tmp_path):
    before = state(marked, module)
    path = tmp_path / "Kápolna.toml"
    assert bpy.ops.fresco.save_project(filepath=str(path)) == {"FINISHED"}
    assert bpy.ops.fresco.open_project(filepath=str(path)) == {"FINISHED"}
    after = state(marked, module)
    assert sorted(map(str, after)) == sorted(map(str, before))
    for key, value in before.items():
        assert after[key] == value, key


def test_the_batch_reads_what_the_window_saved(marked, module, tmp_path):
    path = tmp_path / "room.toml"
    bpy.ops.fresco.save_project(filepath=str(path))
    core = module("core.project")
    project = core.load_project(path)
    assert set(project.regions.outlines) == {"niche"}
    np.testing.assert_allclose(project.regions.outlines["niche"], OPENING, atol=1e-6)
    assert project.regions.unplaced == ("not yet: on the scan",)
    hidden = {mark.name: mark.hidden_path for mark in project.photos[0].photo.regions if mark.hidden_path}
    assert list(hidden) == ["red panel"]
    assert hidden["red panel"] == tmp_path / "room_files" / "masks" / "wall 1" / "red panel.hidden.png"
    masks = {mark.path.resolve() for mark in project.photos[1].photo.regions}
    assert all(tmp_path not in mask.parents for mask in masks)  # mask files are named, not copied


def test_what_was_painted_is_written_as_polygons_too(marked, module, tmp_path):
    photo = marked.fresco.photos[1]
    region = marked.fresco.region_named("red panel")
    painted = np.zeros((photo.size[1], photo.size[0]), dtype=bool)
    painted[40:90, 60:140], painted[55:70, 80:100], painted[100:120, 60:90] = True, False, True
    mark = module("core.photos").RegionMark("red panel", mask=painted)
    module("addon.bridge.regions").write_mark(photo, region, mark, photo.size)
    bpy.ops.fresco.save_project(filepath=str(tmp_path / "room.toml"))
    files = tmp_path / "room_files"
    polygons = module("core.photos").read_polygons(files / "polygons" / "wall 2.geojson")
    assert list(polygons) == ["red panel"]  # marks in mask files of their own are not repeated
    np.testing.assert_array_equal(polygons["red panel"].read_mask(*photo.size), painted)
    mask = module("core.photos").read_mask(files / "masks" / "wall 2" / "red panel.png")
    np.testing.assert_array_equal(mask, painted)


def test_a_scan_from_no_file_is_refused(marked, tmp_path):
    marked.fresco.scan_path = ""
    with pytest.raises(RuntimeError, match="not read from a file"):
        bpy.ops.fresco.save_project(filepath=str(tmp_path / "room.toml"))
    assert not list(tmp_path.iterdir())


def test_what_hides_the_scan_is_saved(marked, module, tmp_path):
    mesh = bpy.data.meshes.new("scaffold")
    mesh.from_pydata([(1, 1, 0), (1.5, 1, 0), (1.5, 1, 2), (1, 1, 2)], [], [(0, 1, 2, 3)])
    occluders = module("addon.bridge.world").collection(marked, "Occluders")
    occluders.objects.link(bpy.data.objects.new("scaffold", mesh))
    path = tmp_path / "room.toml"
    bpy.ops.fresco.save_project(filepath=str(path))
    bpy.ops.fresco.open_project(filepath=str(path))
    (again,) = module("addon.bridge.scans").read_occluders(marked)
    assert again.name.startswith("scaffold") and len(again.faces) == 2
    np.testing.assert_allclose(np.ptp(again.vertices, axis=0), [0.5, 0, 2], atol=1e-6)
