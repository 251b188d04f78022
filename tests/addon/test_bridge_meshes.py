"""Meshes and numpy: every round trip gives back what went in."""

import bpy
import numpy as np
import pytest


@pytest.fixture
def bridge(module):
    return module("addon.bridge.meshes")


def grid(n=20):
    """Triangulated square of n x n cells, vertices (V,3) and faces (F,3)."""
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0))
    vertices = np.stack([x.ravel(), y.ravel(), np.sin(x.ravel())], axis=1)
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    lower = np.stack([corner, corner + 1, corner + n + 2], axis=1)
    upper = np.stack([corner, corner + n + 2, corner + n + 1], axis=1)
    return vertices, np.concatenate([lower, upper]).astype(np.int32)


def test_geometry_round_trip(scene, bridge):
    vertices, faces = grid()
    mesh = bridge.build_mesh("grid", vertices, faces)
    np.testing.assert_array_equal(bridge.read_faces(mesh), faces)
    np.testing.assert_array_equal(bridge.read_positions(mesh), vertices.astype(np.float32))
    assert not mesh.validate(), "Blender had to repair the mesh"
    assert len(mesh.edges) == 20 * 21 * 2 + 400


def test_refilling_a_mesh_replaces_it(scene, bridge):
    mesh = bridge.build_mesh("grid", *grid(30))
    vertices, faces = grid(3)
    bridge.fill_mesh(mesh, vertices, faces)
    np.testing.assert_array_equal(bridge.read_faces(mesh), faces)


@pytest.mark.parametrize("dtype", [np.bool_, np.int32, np.float32])
def test_face_attributes_round_trip_and_change_type(scene, bridge, dtype):
    mesh = bridge.build_mesh("grid", *grid())
    bridge.write_face_attribute(mesh, "a", np.zeros(800, dtype=np.int32))
    values = np.random.default_rng(1).integers(0, 2, 800).astype(dtype)
    bridge.write_face_attribute(mesh, "a", values)
    read = bridge.read_face_attribute(mesh, "a")
    assert read.dtype == dtype
    np.testing.assert_array_equal(read, values)


def test_uvs_round_trip(scene, bridge):
    mesh = bridge.build_mesh("grid", *grid())
    uvs = np.random.default_rng(2).random((800, 3, 2)).astype(np.float32)
    bridge.write_uvs(mesh, "Photos", uvs)
    bridge.write_uvs(mesh, "Photos", uvs)
    assert [layer.name for layer in mesh.uv_layers] == ["Photos"]
    read = np.empty(uvs.size, dtype=np.float32)
    mesh.uv_layers["Photos"].uv.foreach_get("vector", read)
    np.testing.assert_array_equal(read.reshape(uvs.shape), uvs)


def test_selected_faces(scene, bridge):
    mesh = bridge.build_mesh("grid", *grid())
    selected = np.zeros(800, dtype=np.bool_)
    selected[[3, 77]] = True
    bridge.select_faces(mesh, selected)
    np.testing.assert_array_equal(bridge.read_selected_faces(mesh), selected)


def test_other_faces_are_refused_with_a_remedy(scene, bridge, module):
    mesh = bpy.data.meshes.new("quad")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [], [(0, 1, 2, 3)])
    with pytest.raises(module("core.errors").ScanError, match="Triangulate Faces"):
        bridge.read_faces(mesh)
    with pytest.raises(module("core.errors").ScanError, match="needs faces"):
        bridge.read_faces(bpy.data.meshes.new("empty"))
