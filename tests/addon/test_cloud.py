"""A point cloud as scan: regions of points, poses from them, colours for the points, files."""

import bpy
import numpy as np
import pytest

OFFSET = np.array([650_000.0, 5_240_000.0, 100.0])


@pytest.fixture
def cloud(scene, folder, calibrate, room, module):
    """Return the scene with a cloud in grid coordinates, photos, and the panels as regions of its points."""
    path = folder / "cloud.ply"
    points, planes = room.write_cloud(path, offset=OFFSET)
    bpy.ops.fresco.import_scan(filepath=str(path))
    bridge = module("addon.bridge.regions")
    for name, inside in room.on_panels(points, planes).items():
        bridge.write_faces(scene, bridge.add_region(scene, name), inside)
    bpy.ops.fresco.import_photo_folder(directory=str(folder / "photos"))
    calibrate()
    bpy.ops.fresco.import_mask_folder(directory=str(folder / "masks"))
    return scene


def test_points_become_a_mesh_without_faces(cloud, module):
    scan = module("addon.bridge.scans").read_scan(cloud)
    mesh = cloud.fresco.scan.data
    assert len(mesh.polygons) == len(mesh.edges) == 0 and len(mesh.vertices) == 3 * 120**2
    assert scan.is_cloud and scan.vertex_colors is not None
    np.testing.assert_array_equal(module("addon.bridge.world").read_offset(cloud) % 100, 0)
    assert [region.face_count for region in cloud.fresco.regions] == [
        int(module("addon.bridge.regions").read_faces(cloud, region).sum()) for region in cloud.fresco.regions
    ]


def test_photos_are_placed_by_regions_of_points_and_colour_them(cloud, room, module, tmp_path):
    assert bpy.ops.fresco.solve_poses() == {"FINISHED"}
    photos = cloud.fresco.photos
    assert [photo.state for photo in photos] == ["SOLVED"] * 3, [photo.message for photo in photos]
    offset = module("addon.bridge.world").read_offset(cloud)
    for photo, (rotation, translation) in zip(photos, room.POSES, strict=True):
        found, moved, _ = module("addon.bridge.photos").read_pose(cloud, photo)
        centre = -found.T @ moved + offset - OFFSET
        assert np.linalg.norm(centre + rotation.T @ translation) < 0.04
    assert not bpy.ops.fresco.refine_edges.poll() and not bpy.ops.fresco.bake_atlas.poll()

    assert bpy.ops.fresco.texture_scan() == {"FINISHED"}
    rows = dict(line.split("\t") for line in cloud.fresco.texture_report.splitlines())
    assert rows["Photos"] == "3 in use"
    found = module("addon.bridge.clouds").read_clouds(cloud)[""]
    points, planes = room.write_cloud(tmp_path / "same.ply")
    seen = found.selection.view >= 0
    assert seen.mean() > 0.7
    off = np.abs(found.selection.colours.rgb[seen].astype(float) - room.paint(points, planes)[seen])
    assert np.median(off) < 6

    cloud.fresco.export.folder = str(tmp_path)
    assert bpy.ops.fresco.export() == {"FINISHED"}
    written = module("core.scans").read_scan(tmp_path / "cloud_colours.ply")
    np.testing.assert_allclose(written.vertices + written.offset, points + OFFSET, atol=1e-4)
    np.testing.assert_array_equal(written.vertex_colors, found.selection.colours.rgb)
    assert (tmp_path / "cloud_report.html").exists()


def test_regions_follow_into_a_cloud_that_is_imported_again(cloud, room, folder):
    before = [region.face_count for region in cloud.fresco.regions]
    bpy.ops.fresco.import_scan(filepath=str(folder / "cloud.ply"))
    assert [region.face_count for region in cloud.fresco.regions] == before
    room.write_cloud(folder / "elsewhere.ply", offset=OFFSET + np.array([40.0, 0, 0]))
    bpy.ops.fresco.import_scan(filepath=str(folder / "elsewhere.ply"))
    assert [region.face_count for region in cloud.fresco.regions] == [0, 0, 0]
    assert cloud.fresco.scan_report.count("is not in this cloud") == 3
    bpy.ops.fresco.import_scan(filepath=str(folder / "scan.ply"))
    assert "Size" not in cloud.fresco.scan_report


def test_regions_of_points_are_saved_with_the_project(cloud, module, tmp_path):
    read = module("addon.bridge.regions").read_faces
    before = {region.name: read(cloud, region) for region in cloud.fresco.regions}
    path = tmp_path / "points.toml"
    assert bpy.ops.fresco.save_project(filepath=str(path)) == {"FINISHED"}
    assert bpy.ops.fresco.open_project(filepath=str(path)) == {"FINISHED"}
    after = {region.name: read(cloud, region) for region in cloud.fresco.regions}
    assert set(after) == set(before)
    for name, inside in before.items():
        np.testing.assert_array_equal(after[name], inside)


class Straight:
    """A view along -x that stands for Blender's, orthographic: y goes right, z goes up."""

    right = np.array([0.0, 1.0, 0.0])

    def on_screen(self, points, width, height):
        return points[:, 1:] / 3.0 * [width, height], np.ones(len(points), dtype=bool)

    def origins(self, points):
        return points + 50.0 * np.eye(3)[0]


@pytest.fixture
def prepare(module):
    """Return a function that makes points ready for clicks."""

    def run(points):
        index = module("core.regions.surface.cloud_index").index_cloud(points)
        return module("addon.tools.cloud").PreparedCloud(index, points)

    return run


def test_a_click_meets_the_nearest_point_on_its_ray(prepare, room, tmp_path):
    prepared = prepare(room.write_cloud(tmp_path / "cloud.ply")[0])
    eye = np.array([3.0, 2.5, 1.8])
    targets = np.array([[0.0, 1.2, 1.2], [1.2, 0.0, 0.7], [1.0, 1.0, 0.0], [0.0, -1.0, 3.0]])
    element, distance = prepared.first_hit(np.repeat(eye[None], 4, axis=0), targets - eye)
    hit = prepared.vertices[element[:3]]
    assert np.all(np.linalg.norm(hit - targets[:3], axis=1) < 0.05)
    np.testing.assert_allclose(distance[:3], np.linalg.norm(hit - eye, axis=1), atol=0.03)
    assert element[3] == -1
    along = np.array([[-1.0, 0, 0]] * 2)
    element, distance = prepared.first_hit(np.array([[5.0, 1.0, 1.0], [5.0, 2.0, 0.5]]), along)
    assert np.all(np.abs(prepared.vertices[element, 0]) < 0.01) and np.all(np.abs(distance - 5) < 0.02)


def test_points_behind_others_are_not_seen(prepare, room, tmp_path):
    points, planes = room.write_cloud(tmp_path / "cloud.ply")
    wall = points[planes == 0]
    two = prepare(np.concatenate([wall, wall - [0.5, 0, 0]]))
    seen = two.visible(Straight(), np.arange(two.count))
    front = two.vertices[:, 0] > -0.2
    assert seen[front].mean() > 0.97 and seen[~front].mean() < 0.03
