"""Maps, layers, standpoints, atlas and vertex colours in the scene."""

import json

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


def corner_colours(mesh, name, size):
    values = np.empty(4 * size, dtype=np.float32)
    mesh.color_attributes[name].data.foreach_get("color_srgb", values)
    return np.rint(255 * values.reshape(-1, 4)[:, :3]).astype(int)


def test_every_map_colours_the_scan_and_says_what_it_means(textured, module):
    mesh = textured.fresco.scan.data
    maps, bridge = module("core.report.maps"), module("addon.bridge.maps")
    scan = module("addon.bridge.texture").read_texture(textured)
    shown = 0
    for name, make in maps.FACE_MAPS.items():
        expected = make(scan)
        if expected is None:
            assert bpy.ops.fresco.show_map(field=name) == {"CANCELLED"}
            continue
        assert bpy.ops.fresco.show_map(field=name) == {"FINISHED"}
        found = corner_colours(mesh, bridge.COLOURS, 3 * len(mesh.polygons))
        assert np.abs(found[::3] - expected.colours).max() <= 1
        legend = bridge.read_legend(textured)
        assert legend["title"] == expected.title and legend["ends"] == list(expected.ends)
        shown += 1
    assert shown >= 6
    assert mesh.color_attributes.active_color.name == bridge.COLOURS


def test_next_places_become_cameras_that_say_what_they_add(textured):
    textured.fresco.photo_index = 0
    textured.fresco.maps.wanted_texel = 0.004
    textured.fresco.maps.count = 3
    assert bpy.ops.fresco.next_standpoints() == {"FINISHED"}
    found = [obj for obj in bpy.data.objects if obj.name.startswith("Next ")]
    assert 1 <= len(found) <= 3
    gains = [obj["fresco_gain"] for obj in sorted(found, key=lambda obj: obj.name)]
    assert gains == sorted(gains, reverse=True) and gains[0] > 0.05
    assert f"adds {gains[0]:.2f} m²" in sorted(obj.name for obj in found)[0]
    assert "Covered" in textured.fresco.maps.coverage and "Fine enough" in textured.fresco.maps.coverage
    bpy.context.view_layer.update()
    for obj in found:  # inside the room, looking at a wall
        assert min(obj.matrix_world.translation) > 0
        assert min(obj.matrix_world.to_3x3().col[2]) < 0.9
    bpy.ops.fresco.next_standpoints()
    assert len([obj for obj in bpy.data.objects if obj.name.startswith("Next ")]) == len(found)


def test_an_atlas_becomes_a_model_of_its_own(textured, tmp_path, module):
    textured.fresco.export.folder = str(tmp_path)
    textured.fresco.atlas.texel_size = 0.01
    textured.fresco.atlas.page_size = 256
    textured.fresco.atlas.depth = "16"
    assert bpy.ops.fresco.bake_atlas() == {"FINISHED"}
    folder = tmp_path / "scan_atlas"
    pages = sorted(path.name for path in folder.glob("*.png"))
    assert pages and (folder / "scan_atlas.obj").stat().st_size > 1000
    model = bpy.data.objects["scan_atlas"]
    mesh = model.data
    assert [slot.material.name for slot in model.material_slots] == [page[:-4] for page in pages]
    uvs = module("addon.bridge.meshes").read_uvs(mesh, "Atlas")
    assert uvs.min() >= 0 and uvs.max() <= 1
    image = mesh.materials[0].node_tree.nodes.active.image
    assert tuple(image.size) == (256, 256) and image.depth in (48, 64, 96)
    assert "Fresco" in textured.fresco.scan.data.uv_layers, "the scan keeps the originals"
    textured.fresco.atlas.depth = "8"
    bpy.ops.fresco.bake_atlas()
    assert len([obj for obj in bpy.data.objects if obj.name.startswith("scan_atlas")]) == 1


def test_vertices_take_the_colours_of_the_photos(textured, room):
    assert bpy.ops.fresco.colour_vertices() == {"FINISHED"}
    mesh = textured.fresco.scan.data
    found = corner_colours(mesh, "Fresco colour", len(mesh.vertices))
    vertices = np.array([v.co for v in mesh.vertices])
    inside = (vertices[:, 0] < 1e-6) & (np.abs(vertices[:, 1:] - (1.1, 1.0)).max(axis=1) < 0.3)
    red = np.median(found[inside], axis=0)
    assert red[0] > 150 and red[1] < 110, "the red panel"


def test_layers_are_textures_of_their_own_on_one_scan(textured, module):
    photos = textured.fresco.photos
    photos[2].layer = "infrared"
    assert bpy.ops.fresco.texture_scan() == {"FINISHED"}
    scan = textured.fresco.scan
    texture = module("addon.bridge.texture")
    assert texture.layer_names(scan) == ["", "infrared"]
    assert textured.fresco.layer == "" and {"Fresco", "Fresco infrared"} <= set(scan.data.uv_layers.keys())
    assert {view.name for view in texture.read_texture(textured).views} == {"wall 1", "wall 2"}
    visible = set(material_names(scan))
    assert bpy.ops.fresco.next_layer() == {"FINISHED"}
    assert textured.fresco.layer == "infrared" and scan.data.uv_layers.active.name == "Fresco infrared"
    shown = texture.read_texture(textured)
    assert [view.name for view in shown.views] == ["wall 3"] and (shown.selection.view >= 0).any()
    assert set(material_names(scan)) == {"wall 3", "Fresco unseen"} != visible
    bpy.ops.fresco.next_layer()
    assert set(material_names(scan)) == visible
    photos[2].layer = ""
    bpy.ops.fresco.texture_scan()
    assert texture.layer_names(scan) == [""] and "Fresco infrared" not in scan.data.uv_layers
    assert not bpy.ops.fresco.next_layer.poll()
    assert json.loads(scan.data["fresco_layers"]) == [""]


def material_names(scan):
    """Names of the materials that the scan's faces use."""
    index = np.zeros(len(scan.data.polygons), dtype=np.int32)
    scan.data.attributes["material_index"].data.foreach_get("value", index)
    return [scan.data.materials[i].name for i in np.unique(index)]


def test_a_preferred_photo_gets_more_of_the_scan(textured, module):
    texture = module("addon.bridge.texture")
    before = (texture.read_texture(textured).selection.view == 1).sum()
    textured.fresco.photos[1].priority = 3
    bpy.ops.fresco.texture_scan()
    assert (texture.read_texture(textured).selection.view == 1).sum() > 1.3 * before


def test_without_texture_the_buttons_are_grey(imported):
    for name in ("show_map", "next_standpoints", "bake_atlas", "colour_vertices", "next_layer"):
        assert not getattr(bpy.ops.fresco, name).poll(), name
