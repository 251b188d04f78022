"""Simplified models and colour charts in the scene."""

import json
import struct

import bpy
import cv2
import numpy as np
import pytest
from fresco.core.texture.colour.colour_chart import REFERENCE
from fresco.core.texture.colour.difference import lab_to_linear
from fresco.core.texture.views.images import to_bytes, to_srgb


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Return where the solved and textured scene is kept: every test opens it again."""
    return tmp_path_factory.mktemp("kept") / "textured.blend"


@pytest.fixture
def textured(context, kept, request, tmp_path):
    """Return the scene, solved and textured; it exports into a folder of its own."""
    if not kept.exists():
        request.getfixturevalue("imported")
        bpy.ops.fresco.solve_poses()
        bpy.ops.fresco.texture_scan()
        bpy.ops.wm.save_as_mainfile(filepath=str(kept))
    bpy.ops.wm.open_mainfile(filepath=str(kept))
    scene = bpy.context.scene
    scene.fresco.export.folder = str(tmp_path / "out")
    scene.fresco.atlas.texel_size, scene.fresco.atlas.page_size = 0.01, 256
    return scene


def chart_photo(scene, tmp_path, cast):
    """Add a photo that shows nothing but the chart, and choose it."""
    photo = np.full((400, 560, 3), 0.02)
    for number, colour in enumerate(np.clip(lab_to_linear(REFERENCE), 0, 1)):
        x, y = 70 + 70 * (number % 6), 60 + 70 * (number // 6)
        photo[y : y + 60, x : x + 60] = colour * cast
    path = tmp_path / "chart.png"
    cv2.imwrite(str(path), to_bytes(to_srgb(photo))[..., ::-1])
    bpy.ops.fresco.import_photos(directory=str(tmp_path), files=[{"name": "chart.png"}])
    scene.fresco.photo_index = scene.fresco.photos.find("chart")
    return path


def test_a_simplified_model_is_an_object_of_its_own(textured, tmp_path):
    before = len(textured.fresco.scan.data.polygons)
    textured.fresco.delivery.simplify_faces = 400
    assert bpy.ops.fresco.simplify_model() == {"FINISHED"}
    model = bpy.data.objects["scan_simplified"]
    assert 200 < len(model.data.polygons) <= 400
    assert len(textured.fresco.scan.data.polygons) == before, "the scan stays as it is"
    assert "Fresco" in textured.fresco.scan.data.uv_layers
    assert "RMS 0.0" in model["fresco_simplified"]
    assert (tmp_path / "out" / "scan_simplified" / "scan_simplified.obj").is_file()

    textured.fresco.export.write_report = True
    bpy.ops.fresco.export()
    data = (tmp_path / "out" / "scan_simplified.glb").read_bytes()
    content = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
    assert [node["name"] for node in content["nodes"]] == ["scan_simplified"]
    assert len(content["images"]) == len(model.material_slots)
    assert model.hide_get(), "it is hidden again: it lies on the scan"
    assert model["fresco_simplified"] in (tmp_path / "out" / "scan_report.html").read_text()


def test_a_tolerance_gives_the_fewest_faces(textured):
    textured.fresco.delivery.simplify_by = "TOLERANCE"
    textured.fresco.delivery.simplify_tolerance = 0.002
    assert bpy.ops.fresco.simplify_model() == {"FINISHED"}
    assert len(bpy.data.objects["scan_simplified"].data.polygons) < 1000


def test_more_faces_than_there_are_is_a_sentence(textured):
    textured.fresco.delivery.simplify_faces = 10_000_000
    with pytest.raises(RuntimeError, match="ask for fewer"):
        bpy.ops.fresco.simplify_model()
    assert "scan_simplified" not in bpy.data.objects


def test_a_colour_chart_corrects_what_is_baked(textured, tmp_path):
    bpy.ops.fresco.colour_vertices()
    before = colours(textured)
    chart_photo(textured, tmp_path, (1.0, 0.8, 0.5))
    assert bpy.ops.fresco.find_colour_chart() == {"FINISHED"}
    assert "before" in textured.fresco.delivery.chart_told
    bpy.ops.fresco.colour_vertices()
    lift = (colours(textured) - before).mean(axis=0)
    assert lift[2] > lift[1] > 1, "the light lacked blue most"
    assert bpy.ops.fresco.forget_colour_chart() == {"FINISHED"}
    bpy.ops.fresco.colour_vertices()
    np.testing.assert_array_equal(colours(textured), before)


def test_what_was_made_is_asked_for_by_the_saved_project(textured, module, tmp_path):
    chart_photo(textured, tmp_path, (1.0, 0.8, 0.5))
    bpy.ops.fresco.find_colour_chart()
    textured.fresco.delivery.simplify_by, textured.fresco.delivery.simplify_tolerance = "TOLERANCE", 0.004
    bpy.ops.fresco.simplify_model()
    told, path = textured.fresco.delivery.chart_told, tmp_path / "room.toml"
    assert bpy.ops.fresco.save_project(filepath=str(path)) == {"FINISHED"}
    project = module("core.project").load_project(path)
    assert project.simplify.tolerance == pytest.approx(0.004) and project.simplify.faces is None
    assert len(project.charts) == 1 and project.atlas is not None
    textured.fresco.delivery.simplify_by, textured.fresco.delivery.charts_json = "FACES", ""
    assert bpy.ops.fresco.open_project(filepath=str(path)) == {"FINISHED"}
    assert textured.fresco.delivery.chart_told == told
    assert textured.fresco.delivery.simplify_by == "TOLERANCE"


def test_a_photo_without_chart_is_refused(textured):
    textured.fresco.photo_index = 0
    textured.fresco.region_index = -1
    with pytest.raises(RuntimeError, match="No colour chart was found"):
        bpy.ops.fresco.find_colour_chart()
    assert not textured.fresco.delivery.charts_json


def colours(scene):
    mesh = scene.fresco.scan.data
    found = np.empty(4 * len(mesh.vertices))
    mesh.color_attributes["Fresco colour"].data.foreach_get("color_srgb", found)
    return 255 * found.reshape(-1, 4)[:, :3]
