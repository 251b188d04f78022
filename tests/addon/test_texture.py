"""Texturing in the scene: the right photo's pixels on every face."""

import json

import bpy
import numpy as np
import pytest


@pytest.fixture
def posed(imported, room, module):
    """Return the scene with the photos at their true poses."""
    for photo, pose in zip(imported.fresco.photos, room.POSES, strict=True):
        module("addon.bridge.photos").write_pose(imported, photo, *pose)
        photo.state = "SOLVED"
    bpy.context.view_layer.update()
    return imported


def attribute(mesh, name, dtype):
    values = np.empty(len(mesh.polygons), dtype=dtype)
    mesh.attributes[name].data.foreach_get("value", values)
    return values


def face_centres(scan):
    centres = np.empty(3 * len(scan.data.polygons))
    scan.data.polygons.foreach_get("center", centres)
    return centres.reshape(-1, 3)


def read_uvs(mesh):
    uvs = np.empty(2 * len(mesh.loops), dtype=np.float32)
    mesh.uv_layers["Fresco"].uv.foreach_get("vector", uvs)
    return uvs.reshape(-1, 3, 2)


def test_uvs_show_the_true_pixels(posed, room, module):
    assert bpy.ops.fresco.texture_scan() == {"FINISHED"}
    scan, mesh = posed.fresco.scan, posed.fresco.scan.data
    camera = module("core.cameras").PerspectiveCamera(*room.SIZE, room.K, room.DISTORTION)
    chosen = attribute(mesh, "fresco_view", np.int32)
    assert (chosen >= 0).mean() > 0.8
    corners = np.array([[mesh.vertices[v].co for v in p.vertices] for p in mesh.polygons])
    uvs = read_uvs(mesh)
    for number, (rotation, translation) in enumerate(room.POSES):
        faces = np.flatnonzero(chosen == number)
        pixels = camera.project(corners[faces].reshape(-1, 3) @ rotation.T + translation)
        expected = np.stack([(pixels[:, 0] + 0.5) / 480, 1 - (pixels[:, 1] + 0.5) / 320], axis=1)
        np.testing.assert_allclose(uvs[faces].reshape(-1, 2), expected, atol=2e-6)
    assert len(face_centres(scan)) == len(chosen)


def test_blender_shows_the_panels_in_their_colours(posed, room):
    """Sample each photo at the UV centre of a panel's faces, the way Blender's texture does."""
    bpy.ops.fresco.texture_scan()
    mesh = posed.fresco.scan.data
    uvs, slots = read_uvs(mesh).mean(axis=1), attribute(mesh, "material_index", np.int32)
    for region in posed.fresco.regions:
        faces = np.flatnonzero(attribute(mesh, region.attribute, bool) & (slots > 0))
        assert len(faces) > 20
        for face in faces[::17]:
            nodes = mesh.materials[int(slots[face])].node_tree.nodes
            image = next(node.image for node in nodes if node.type == "TEX_IMAGE")
            x, y = (uvs[face] * image.size[:]).astype(int)
            color = np.array(image.pixels[4 * (y * 480 + x) : 4 * (y * 480 + x) + 3]) * 255
            np.testing.assert_allclose(color, room.COLORS[region.name], atol=2)


def test_one_material_per_photo_used_again(posed):
    bpy.ops.fresco.texture_scan()
    first = [material.name for material in posed.fresco.scan.data.materials]
    used = np.unique(attribute(posed.fresco.scan.data, "fresco_view", np.int32))
    assert len(first) == np.count_nonzero(used >= 0) + 1
    bpy.ops.fresco.texture_scan()
    assert [material.name for material in posed.fresco.scan.data.materials] == first
    assert len(bpy.data.materials) == len(first)
    for photo in (photo for photo in posed.fresco.photos if photo.material is not None):
        texture = next(n for n in photo.material.node_tree.nodes if n.type == "TEX_IMAGE")
        assert texture.image == photo.image
        assert bpy.path.abspath(texture.image.filepath) == photo.path


def test_a_panorama_goes_on_at_its_other_side_and_other_photos_end(posed, module):
    bpy.ops.fresco.texture_scan()
    mesh, bridge = posed.fresco.scan.data, module("addon.bridge.texture")
    selection = bridge.read_texture(posed).selection
    photos = [photo for photo in posed.fresco.photos if photo.material is not None]
    whole = module("core.cameras").EquirectangularCamera(480, 240)
    photos[0].camera_json = json.dumps(module("core.cameras.files").camera_to_dict(whole))
    bridge.write_slots(mesh, selection, list(posed.fresco.photos), "Fresco")
    assert [extension(photo.material) for photo in photos] == ["REPEAT"] + ["EXTEND"] * (len(photos) - 1)


def extension(material):
    return next(node.extension for node in material.node_tree.nodes if node.type == "TEX_IMAGE")


def test_unseen_faces_are_neutral(posed):
    for photo in list(posed.fresco.photos)[1:]:
        photo.use_texture = False
    posed.fresco.photos[0].camera.rotation_euler.z += 0.5
    bpy.context.view_layer.update()
    bpy.ops.fresco.texture_scan()
    mesh = posed.fresco.scan.data
    unseen = attribute(mesh, "fresco_view", np.int32) < 0
    assert unseen.any() and not unseen.all()
    assert (attribute(mesh, "material_index", np.int32)[unseen] == 0).all()
    assert mesh.materials[0].name == "Fresco unseen"
    output = mesh.materials[0].node_tree.get_output_node("ALL")
    (link,) = output.inputs["Surface"].links
    assert link.from_socket.type == "RGBA", "shines by itself as the photos do: not black without lamps"
    assert "Covered" in posed.fresco.texture_report


def test_large_faces_are_split_and_keep_their_region(posed):
    scan = posed.fresco.scan
    before = {r.name: region_area(scan.data, r) for r in posed.fresco.regions}
    posed.fresco.texture.uv_tolerance = 0.02
    bpy.ops.fresco.texture_scan()
    assert len(scan.data.polygons) > 3456
    assert not scan.data.validate()
    for region in posed.fresco.regions:
        assert region_area(scan.data, region) == pytest.approx(before[region.name], rel=1e-5)
        assert region.face_count == attribute(scan.data, region.attribute, bool).sum()


def region_area(mesh, region):
    areas = np.empty(len(mesh.polygons))
    mesh.polygons.foreach_get("area", areas)
    return areas[attribute(mesh, region.attribute, bool)].sum()


def test_maps_tell_photo_and_texel(posed):
    bpy.ops.fresco.texture_scan()
    mesh = posed.fresco.scan.data
    assert json.loads(mesh["fresco_photos"]) == ["wall 1", "wall 2", "wall 3"]
    seen = attribute(mesh, "fresco_view", np.int32) >= 0
    texel = attribute(mesh, "fresco_texel_size", np.float32)
    assert 0.004 < np.median(texel[seen]) < 0.02
    assert np.isnan(texel[~seen]).all()


def test_every_field_of_a_selection_is_kept_and_read_back(posed, module):
    bpy.ops.fresco.texture_scan()
    texture = module("addon.bridge.texture")
    first = texture.read_texture(posed)
    fields = vars(first.selection)
    for name, values in fields.items():
        per_face = name == "uv" or name in texture.MAPS
        assert len(values) == (len(first.faces) if per_face else len(first.views)), name
    texture.show_layers(posed, {"": first})
    again = vars(texture.read_texture(posed).selection)
    for name, values in fields.items():
        if values.dtype.kind == "U":
            np.testing.assert_array_equal(again[name], values)
        else:
            np.testing.assert_allclose(again[name], values, atol=1e-3, err_msg=name)


def test_nothing_to_texture_with_keeps_the_button_grey(imported):
    assert not bpy.ops.fresco.texture_scan.poll()


def test_a_photo_that_vanished_is_a_sentence_and_changes_nothing(posed, folder, tmp_path):
    photo = posed.fresco.photos[1]
    photo.image.filepath = str(tmp_path / "gone.png")
    with pytest.raises(RuntimeError, match=r"gone\.png"):
        bpy.ops.fresco.texture_scan()
    mesh = posed.fresco.scan.data
    assert "Fresco" not in mesh.uv_layers and "fresco_view" not in mesh.attributes
    assert len(mesh.materials) == 0


def test_texture_survives_saving(posed, tmp_path):
    bpy.ops.fresco.texture_scan()
    chosen = attribute(posed.fresco.scan.data, "fresco_view", np.int32)
    uvs = read_uvs(posed.fresco.scan.data)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a b.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a b.blend"))
    mesh = bpy.context.scene.fresco.scan.data
    np.testing.assert_array_equal(attribute(mesh, "fresco_view", np.int32), chosen)
    np.testing.assert_array_equal(read_uvs(mesh), uvs)
    assert bpy.ops.fresco.solve_poses() == {"FINISHED"}
    assert bpy.ops.fresco.texture_scan() == {"FINISHED"}


def test_an_occluder_hides_the_scan(posed):
    bpy.ops.fresco.texture_scan()
    before = attribute(posed.fresco.scan.data, "fresco_view_count", np.int32).sum()
    bpy.ops.mesh.primitive_plane_add(size=1.2, location=(1.5, 1.5, 1.0), rotation=(0.9, 0, 2.3))
    plane = bpy.context.object
    bpy.ops.mesh.primitive_cube_add()  # not selected: stays out of it
    bpy.ops.object.select_all(action="DESELECT")
    assert not bpy.ops.fresco.add_occluders.poll()
    plane.select_set(True)
    bpy.ops.fresco.add_occluders()
    assert bpy.ops.fresco.texture_scan() == {"FINISHED"}
    assert attribute(posed.fresco.scan.data, "fresco_view_count", np.int32).sum() < 0.9 * before
    assert len(plane.data.materials) == 0
