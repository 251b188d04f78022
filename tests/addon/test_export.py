"""What is delivered from a scene, and that nothing is left half-written."""

import dataclasses
import json
import struct

import bpy
import numpy as np
import pytest


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Return where the solved and textured scene is kept: every test opens it again."""
    return tmp_path_factory.mktemp("kept") / "textured.blend"


@pytest.fixture
def textured(context, kept, request):
    """Return the scene, solved and textured."""
    if not kept.exists():
        request.getfixturevalue("imported")
        bpy.ops.fresco.solve_poses()
        bpy.ops.fresco.texture_scan()
        bpy.ops.wm.save_as_mainfile(filepath=str(kept))
    bpy.ops.wm.open_mainfile(filepath=str(kept))
    return bpy.context.scene


@pytest.fixture
def target(textured, tmp_path):
    """Return the folder that the panel is set to export to; the report, which takes long, is left out."""
    path = tmp_path / "kész munka"
    textured.fresco.export.folder = str(path)
    textured.fresco.export.write_report = False
    return path


def glb_json(path):
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON" and size % 4 == 0
    return json.loads(data[20 : 20 + size])


def test_everything_is_written(textured, target, folder):
    textured.fresco.export.write_blend = textured.fresco.export.write_report = True
    assert bpy.ops.fresco.export() == {"FINISHED"}
    names = {path.name for path in target.iterdir()}
    assert names == {"scan.glb", "scan.obj", "scan.mtl", "scan_report.html", "scan.blend"}
    text = (target / "scan_report.html").read_text()
    assert "wall 1" in text and "wall 3" in text
    for photo in sorted((folder / "photos").iterdir()):
        material = (target / "scan.mtl").read_text()
        if photo.stem.replace(" ", "_") in material:
            assert photo.name in material


def test_glb_has_unlit_photos_and_the_cameras(textured, target):
    bpy.ops.fresco.export()
    content = glb_json(target / "scan.glb")
    unlit = [m for m in content["materials"] if "KHR_materials_unlit" in m.get("extensions", {})]
    assert sum("baseColorTexture" in m["pbrMetallicRoughness"] for m in unlit) == len(content["images"]) >= 1
    (unseen,) = [m for m in unlit if m["name"] == "Fresco unseen"]
    np.testing.assert_allclose(unseen["pbrMetallicRoughness"]["baseColorFactor"], [0.36] * 3 + [1], atol=1e-6)
    cameras = [node["name"] for node in content["nodes"] if "camera" in node]
    assert cameras == ["wall 1", "wall 2", "wall 3"]
    assert content["asset"]["extras"]["world_offset"] == [0, 0, 0]
    assert "camera_json" not in json.dumps(content), "what Fresco keeps in the .blend stays there"


def test_glb_has_the_gains_of_the_photos_as_factors_up_to_one(textured, target, module):
    texture = module("addon.bridge.texture")
    once = texture.read_texture(textured)
    gain = np.array([[1.25, 1.0, 0.8], [0.5, 0.75, 1.0], [1.0, 1.0, 1.0]])
    selection = dataclasses.replace(once.selection, gain=gain)
    photos = list(textured.fresco.photos)
    texture.show_layers(textured, {"": dataclasses.replace(once, selection=selection)})
    bpy.ops.fresco.export()
    content = glb_json(target / "scan.glb")
    assert content["asset"]["extras"]["gain_scale"] == 1.25
    factors = {m["name"]: m["pbrMetallicRoughness"].get("baseColorFactor") for m in content["materials"]}
    used = [number for number, photo in enumerate(photos) if photo.name in factors]
    assert used
    for number in used:
        np.testing.assert_allclose(factors[photos[number].name], [*(gain[number] / 1.25), 1])


def test_every_layer_is_delivered(textured, target, module):
    photos = textured.fresco.photos
    photos[2].layer = "infrared"
    bpy.ops.fresco.texture_scan()
    textured.fresco.export.write_report = True
    assert bpy.ops.fresco.export() == {"FINISHED"}
    names = {path.name for path in target.iterdir()}
    assert {"scan.glb", "scan_infrared.glb", "scan.obj", "scan_infrared.obj", "scan_report.html"} <= names
    for ending, used in {"": {"wall 1", "wall 2"}, "_infrared": {"wall 3"}}.items():
        content = glb_json(target / f"scan{ending}.glb")
        textures = {m["name"] for m in content["materials"] if "Fresco" not in m["name"]}
        assert textures and textures <= used
        maps = content["meshes"][0]["primitives"]
        shown = {
            m["pbrMetallicRoughness"].get("baseColorTexture", {}).get("texCoord", 0)
            for m in content["materials"]
        }
        assert all(f"TEXCOORD_{number}" in primitive["attributes"] for primitive in maps for number in shown)
    assert textured.fresco.layer == "", "the window shows what it showed"
    assert "Layer “infrared”" in (target / "scan_report.html").read_text()


def test_glb_comes_back_as_it_was(textured, target):
    bpy.ops.fresco.export()
    before = len(textured.fresco.scan.data.polygons)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.import_scene.gltf(filepath=str(target / "scan.glb"))
    mesh = next(obj.data for obj in bpy.data.objects if obj.type == "MESH")
    assert len(mesh.polygons) == before
    assert mesh.uv_layers


def test_the_selection_stays_as_it_was(textured, target):
    bpy.ops.object.select_all(action="DESELECT")
    textured.fresco.photos[1].camera.select_set(True)
    bpy.ops.fresco.export()
    assert [obj.name for obj in bpy.context.selected_objects] == ["wall 2"]


def test_obj_is_in_true_coordinates(textured, target):
    textured["fresco_offset"] = [5_000_000.0, 512_300.0, 0.0]
    bpy.ops.fresco.export()
    lines = (target / "scan.obj").read_text().splitlines()
    vertices = np.array([line.split()[1:4] for line in lines if line.startswith("v ")], dtype=float)
    assert len(vertices) == len(textured.fresco.scan.data.vertices)
    np.testing.assert_allclose(vertices.min(axis=0), (5_000_000, 512_300, 0), atol=1e-5)
    assert sum(line.startswith("f ") for line in lines) == len(textured.fresco.scan.data.polygons)


def test_unsaved_file_has_no_folder_beside_it(imported):
    imported.fresco.texture_report = "Covered\t1 %"
    imported.fresco.export.folder = "//fresco/"
    with pytest.raises(RuntimeError, match="save that first, or choose a folder"):
        bpy.ops.fresco.export()


def test_a_folder_that_is_a_file_is_a_sentence(textured, tmp_path):
    (tmp_path / "taken").write_text("here already")
    textured.fresco.export.folder = str(tmp_path / "taken")
    with pytest.raises(RuntimeError, match="cannot be written"):
        bpy.ops.fresco.export()
    assert (tmp_path / "taken").read_text() == "here already"


@pytest.mark.parametrize("ending", [".glb", ".blend"])
def test_a_file_that_cannot_be_replaced_is_a_sentence(textured, target, ending):
    (target / f"scan{ending}").mkdir(parents=True)
    textured.fresco.export.write_blend = True
    with pytest.raises(RuntimeError, match=f"scan\\{ending}: cannot be written"):
        bpy.ops.fresco.export()
    assert not [path.name for path in target.iterdir() if "part" in path.name or path.name.endswith("@")]


def test_a_removed_photo_asks_for_a_new_texture(textured, target):
    name = json.loads(textured.fresco.scan.data["fresco_photos"])[0]
    textured.fresco.photo_index = textured.fresco.photos.find(name)
    bpy.ops.fresco.remove_photo()
    with pytest.raises(RuntimeError, match="was removed since the scan was textured"):
        bpy.ops.fresco.export()
    assert not target.exists() or not list(target.iterdir())


def test_without_texture_the_button_is_grey(imported):
    assert not bpy.ops.fresco.export.poll()
