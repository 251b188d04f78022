"""Meshes between Blender and numpy, by attributes: with the exact type each transfer is one copy.

Blender's coordinates are metres relative to the scene's offset (`world`); core's are true world coordinates.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...core.arrays import AnyArray, ArrayLike, BoolArray, FloatArray, IntArray
from ...core.errors import ScanError
from .world import matrix_to_array

_ATTRIBUTE_TYPES = {
    np.dtype(np.bool_): "BOOLEAN",
    np.dtype(np.int32): "INT",
    np.dtype(np.float32): "FLOAT",
}


def build_mesh(name: str, vertices: ArrayLike, faces: IntArray) -> bpy.types.Mesh:
    """Create a triangle mesh: (V,3) Blender coordinates in metres, (F,3) int."""
    mesh = bpy.data.meshes.new(name)
    fill_mesh(mesh, vertices, faces)
    return mesh


def fill_mesh(mesh: bpy.types.Mesh, vertices: ArrayLike, faces: IntArray) -> None:
    """Replace all of a mesh's geometry by triangles: (V,3) Blender coordinates in metres, (F,3) int."""
    mesh.clear_geometry()
    positions = np.ascontiguousarray(vertices, dtype=np.float32)
    corners = np.ascontiguousarray(faces, dtype=np.int32)
    mesh.vertices.add(len(positions))
    mesh.attributes["position"].data.foreach_set("vector", positions.ravel())
    if len(corners):
        _fill_faces(mesh, corners)
    mesh.update(calc_edges=True)
    if len(corners):
        mesh.shade_flat()  # a scan's facets are what was measured
    for name in (".select_vert", ".select_edge", ".select_poly"):  # new geometry comes selected
        remove_attribute(mesh, name)


def _fill_faces(mesh: bpy.types.Mesh, corners: IntArray) -> None:
    mesh.loops.add(corners.size)
    mesh.polygons.add(len(corners))
    starts = np.arange(0, corners.size, 3, dtype=np.int32)
    mesh.polygons.foreach_set("loop_start", starts)
    mesh.attributes[".corner_vert"].data.foreach_set("value", corners.ravel())


def is_cloud(mesh: bpy.types.Mesh) -> bool:
    """Whether a mesh has points only."""
    return len(mesh.polygons) == 0 and len(mesh.vertices) > 0


def element_count(mesh: bpy.types.Mesh) -> int:
    """Number of what regions consist of: faces, or the points of a cloud."""
    return len(mesh.vertices) if is_cloud(mesh) else len(mesh.polygons)


def element_name(mesh: bpy.types.Mesh) -> str:
    """What regions consist of, in words."""
    return "points" if is_cloud(mesh) else "faces"


def is_triangulated(mesh: bpy.types.Mesh) -> bool:
    """Whether every face has three corners."""
    return len(mesh.loops) == 3 * len(mesh.polygons) == 3 * len(mesh.loop_triangles)


def read_faces(mesh: bpy.types.Mesh) -> IntArray:
    """Vertex indices (F,3) of a mesh of triangles; `ScanError` if it has other faces."""
    if len(mesh.polygons) == 0:
        raise ScanError(f"{mesh.name} has points only, and this needs faces: mesh the point cloud first.")
    if not is_triangulated(mesh):
        raise ScanError(
            f"{mesh.name} has faces with more than three corners: triangulate it first "
            "(Edit Mode, Face > Triangulate Faces)."
        )
    corners = np.empty(len(mesh.loops), dtype=np.int32)
    mesh.attributes[".corner_vert"].data.foreach_get("value", corners)
    return corners.reshape(-1, 3)


def read_any_faces(mesh: bpy.types.Mesh) -> IntArray:
    """Vertex indices (F,3) of a mesh of triangles; none of a point cloud."""
    return np.zeros((0, 3), dtype=np.int32) if is_cloud(mesh) else read_faces(mesh)


def read_triangles(mesh: bpy.types.Mesh) -> IntArray:
    """Vertex indices (F,3) of a mesh cut into triangles, which may have faces of any kind."""
    mesh.calc_loop_triangles()
    corners = np.empty(3 * len(mesh.loop_triangles), dtype=np.int32)
    mesh.loop_triangles.foreach_get("vertices", corners)
    return corners.reshape(-1, 3)


def read_positions(mesh: bpy.types.Mesh) -> AnyArray:
    """Vertex coordinates (V,3) float32 in the object's own frame, metres."""
    positions = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.attributes["position"].data.foreach_get("vector", positions)
    return positions.reshape(-1, 3)


def read_vertices(obj: bpy.types.Object) -> FloatArray:
    """Vertices (V,3) of an object in Blender's world, metres, in double precision."""
    matrix = matrix_to_array(obj.matrix_world)
    return read_positions(obj.data).astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def to_object_frame(obj: bpy.types.Object, vertices: FloatArray) -> FloatArray:
    """Vertices (V,3) of Blender's world, metres -> the object's own frame: the inverse of `read_vertices`."""
    matrix = matrix_to_array(obj.matrix_world)
    return (vertices - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T


def write_face_attribute(mesh: bpy.types.Mesh, name: str, values: AnyArray) -> None:
    """Store one value per face (bool, int32 or float32) under a name, replacing what is there."""
    _write_attribute(mesh, name, values, "FACE")


def write_element_attribute(mesh: bpy.types.Mesh, name: str, values: AnyArray) -> None:
    """Store one value per face, or per point of a cloud, like `write_face_attribute`."""
    _write_attribute(mesh, name, values, "POINT" if is_cloud(mesh) else "FACE")


def _write_attribute(mesh: bpy.types.Mesh, name: str, values: AnyArray, domain: str) -> None:
    kind = _ATTRIBUTE_TYPES[values.dtype]
    attribute = mesh.attributes.get(name)
    if attribute is not None and (attribute.domain != domain or attribute.data_type != kind):
        mesh.attributes.remove(attribute)
        attribute = None
    if attribute is None:
        attribute = mesh.attributes.new(name, kind, domain)
    attribute.data.foreach_set("value", np.ascontiguousarray(values))


def read_face_attribute(mesh: bpy.types.Mesh, name: str) -> AnyArray | None:
    """Values per face (F,) of a bool, int or float attribute, or None where there is none of that name."""
    return _read_attribute(mesh, name, "FACE")


def read_element_attribute(mesh: bpy.types.Mesh, name: str) -> AnyArray | None:
    """Values per face, or per point of a cloud, like `read_face_attribute`."""
    return _read_attribute(mesh, name, "POINT" if is_cloud(mesh) else "FACE")


def _read_attribute(mesh: bpy.types.Mesh, name: str, domain: str) -> AnyArray | None:
    attribute = mesh.attributes.get(name)
    if attribute is None or attribute.domain != domain:
        return None
    types = {kind: dtype for dtype, kind in _ATTRIBUTE_TYPES.items()}
    if attribute.data_type not in types:
        return None
    values = np.empty(len(attribute.data), dtype=types[attribute.data_type])
    attribute.data.foreach_get("value", values)
    return values


def remove_attribute(mesh: bpy.types.Mesh, name: str) -> None:
    """Remove an attribute if it is there."""
    attribute = mesh.attributes.get(name)
    if attribute is not None:
        mesh.attributes.remove(attribute)


def face_attribute_names(mesh: bpy.types.Mesh) -> list[str]:
    """Names of the face attributes that `read_face_attribute` can read."""
    kinds = _ATTRIBUTE_TYPES.values()
    return [a.name for a in mesh.attributes if a.domain == "FACE" and a.data_type in kinds]


def read_selected_faces(mesh: bpy.types.Mesh) -> BoolArray:
    """Which faces, or points of a cloud, are selected; the mesh must not be in Edit Mode."""
    selected = read_element_attribute(mesh, ".select_vert" if is_cloud(mesh) else ".select_poly")
    return np.zeros(element_count(mesh), dtype=np.bool_) if selected is None else selected


def read_group_faces(obj: bpy.types.Object, group: int) -> BoolArray:
    """Faces of a mesh of triangles whose corners all belong to a vertex group; of a cloud its points."""
    weights = (
        any(entry.group == group and entry.weight > 0 for entry in v.groups) for v in obj.data.vertices
    )
    member = np.fromiter(weights, dtype=np.bool_, count=len(obj.data.vertices))
    return member if is_cloud(obj.data) else member[read_faces(obj.data)].all(axis=1)


def select_faces(mesh: bpy.types.Mesh, selected: BoolArray) -> None:
    """Select exactly these faces with their vertices and edges, or these points of a cloud.

    The mesh must not be in Edit Mode.
    """
    if is_cloud(mesh):
        mesh.vertices.foreach_set("select", selected)
        return
    vertices = np.zeros(len(mesh.vertices), dtype=np.bool_)
    vertices[read_faces(mesh)[selected].ravel()] = True
    edges = np.empty(2 * len(mesh.edges), dtype=np.int32)
    mesh.attributes[".edge_verts"].data.foreach_get("value", edges)
    mesh.vertices.foreach_set("select", vertices)
    mesh.edges.foreach_set("select", vertices[edges.reshape(-1, 2)].all(axis=1))
    mesh.polygons.foreach_set("select", selected)


def write_uvs(mesh: bpy.types.Mesh, name: str, uvs: ArrayLike) -> None:
    """Store Blender UVs (F,3,2) of a triangle mesh in the UV map of that name and make it the active one."""
    layer = mesh.uv_layers.get(name) or mesh.uv_layers.new(name=name, do_init=False)
    if layer is None:
        raise ScanError("The mesh already has eight UV maps, Blender's limit: remove one and texture again.")
    layer.uv.foreach_set("vector", np.ascontiguousarray(uvs, dtype=np.float32).ravel())
    mesh.uv_layers.active = layer
    layer.active_render = True


def read_uvs(mesh: bpy.types.Mesh, name: str) -> FloatArray:
    """Blender UVs (F,3,2) of a triangle mesh."""
    uvs = np.empty(2 * len(mesh.loops), dtype=np.float32)
    mesh.uv_layers[name].uv.foreach_get("vector", uvs)
    return uvs.reshape(-1, 3, 2).astype(np.float64)


def write_material_indices(mesh: bpy.types.Mesh, indices: IntArray) -> None:
    """Store the material slot (F,) of every face."""
    write_face_attribute(mesh, "material_index", np.ascontiguousarray(indices, dtype=np.int32))
    mesh.update()
