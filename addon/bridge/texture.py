"""The texture on Blender's mesh: UVs into the original photos, a material per photo, maps as attributes."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping

import bpy
import numpy as np

from ...core.arrays import FloatArray, IntArray
from ...core.errors import TextureError
from ...core.project import TexturedScan
from ...core.texture import Selection
from ...core.texture.views.images import full_turn
from ..properties import FrescoPhoto
from . import materials, meshes
from .colours import carry_over
from .photos import read_camera, read_view
from .regions import count_faces
from .scans import read_scan

PHOTOS_KEY = "fresco_photos"
"""ID property of the mesh: the names of the photos that the maps count, as JSON."""
NUMBERS_KEY = "fresco_texture"
"""ID property of the mesh: what a selection says of every photo, as JSON."""
SLOTS_KEY = "fresco_slots"
"""ID property of the mesh: material slot of every photo, as JSON. A layer's name follows all these keys."""
LAYERS_KEY = "fresco_layers"
"""ID property of the mesh: names of its layers, as JSON."""
MAPS = ("view", "runner_up", "view_count", "texel_size", "angle", "blur")
"""Fields of core's selection with one value per face: kept as face attributes "fresco_FIELD"."""


def attribute_name(field: str, layer: str = "") -> str:
    """Name of the face attribute that keeps a field of a layer's selection."""
    return f"fresco_{field}_{layer}" if layer else f"fresco_{field}"


def uv_name(layer: str = "") -> str:
    """Name of the UV map into the photos of a layer."""
    return f"{materials.UV_MAP} {layer}" if layer else materials.UV_MAP


def _photo_fields() -> list[str]:
    """Fields of core's selection with one entry per photo."""
    return [field.name for field in dataclasses.fields(Selection) if field.name not in {*MAPS, "uv"}]


def show_layers(scene: bpy.types.Scene, layers: Mapping[str, TexturedScan]) -> None:
    """Lay the texture of every layer on the scene's scan, and show the one without a name, or the first."""
    scan, items = scene.fresco.scan, scene.fresco.photos
    layers = {name: layers[name] for name in sorted(layers, key=lambda layer: layer != "")}
    first = next(iter(layers.values()))
    if len(first.faces) != len(scan.data.polygons):
        before = read_scan(scene)
        refine_mesh(scan, first)
        carry_over(scan.data, before, first)
    remove_layers(scan.data)
    scan.data.materials.append(materials.unseen_material())
    for layer, textured in layers.items():
        write_layer(scan.data, layer, textured, [items[view.name] for view in textured.views])
    scan.data[LAYERS_KEY] = json.dumps(list(layers))
    count_faces(scene)
    show_layer(scene, next(iter(layers)))


def layer_names(scan: bpy.types.Object | None) -> list[str]:
    """Names of the layers that a scan has, the first one first; that without a name is “”."""
    return [] if scan is None else list(json.loads(scan.data.get(LAYERS_KEY, "[]")))


def show_layer(scene: bpy.types.Scene, layer: str) -> None:
    """Show a layer: its photo's material on every face, its UV map; and tell its numbers."""
    mesh = scene.fresco.scan.data
    view = meshes.read_face_attribute(mesh, attribute_name("view", layer))
    if view is None:
        raise TextureError(f"The scan has no layer “{layer}”: texture it again.")
    slots = np.array(json.loads(mesh[SLOTS_KEY + layer]), dtype=np.int32)
    meshes.write_material_indices(mesh, slots[view])  # the last slot stands for -1
    uv_map = mesh.uv_layers[uv_name(layer)]
    mesh.uv_layers.active, uv_map.active_render = uv_map, True
    scene.fresco.layer = layer
    textured = read_texture(scene)
    scene.fresco.texture_report = "\n".join("\t".join(row) for row in texture_rows(textured))
    scene.fresco.texture_warnings = "\n".join(textured.selection.warnings)


def remove_layers(mesh: bpy.types.Mesh) -> None:
    """Take all layers off a mesh: their materials, UV maps and maps."""
    mesh.materials.clear()
    for layer in json.loads(mesh.get(LAYERS_KEY, "[]")):
        for field in MAPS:
            meshes.remove_attribute(mesh, attribute_name(field, layer))
        if uv_name(layer) in mesh.uv_layers:
            mesh.uv_layers.remove(mesh.uv_layers[uv_name(layer)])
        for key in (PHOTOS_KEY, NUMBERS_KEY, SLOTS_KEY):
            mesh.pop(key + layer, None)


def write_layer(mesh: bpy.types.Mesh, layer: str, textured: TexturedScan, photos: list[FrescoPhoto]) -> None:
    """Keep a layer on a mesh: materials, UVs, maps. `photos` are those that its selection counts."""
    selection = textured.selection
    mesh[SLOTS_KEY + layer] = json.dumps(write_slots(mesh, selection, photos, uv_name(layer)).tolist())
    meshes.write_uvs(mesh, uv_name(layer), photo_uvs(selection, photos))
    mesh[PHOTOS_KEY + layer] = json.dumps([photo.name for photo in photos])
    numbers = {name: getattr(selection, name).tolist() for name in _photo_fields()}
    mesh[NUMBERS_KEY + layer] = json.dumps(numbers)
    for field in MAPS:
        meshes.write_face_attribute(mesh, attribute_name(field, layer), getattr(selection, field))


def refine_mesh(scan: bpy.types.Object, textured: TexturedScan) -> None:
    """Replace the scan's mesh by its refined one; every new face inherits its parent's attributes."""
    mesh = scan.data
    names = [n for n in meshes.face_attribute_names(mesh) if not n.startswith(".") and n != "material_index"]
    kept = {name: meshes.read_face_attribute(mesh, name) for name in names}
    meshes.fill_mesh(mesh, meshes.to_object_frame(scan, textured.vertices), textured.faces)
    for name, values in kept.items():
        if values is not None:
            meshes.write_face_attribute(mesh, name, values[textured.parent])


def write_slots(
    mesh: bpy.types.Mesh, selection: Selection, photos: list[FrescoPhoto], uv_map: str
) -> IntArray:
    """Give the mesh one slot per photo in use; -> slot of every photo, the neutral one (0) last."""
    slots = np.zeros(len(photos) + 1, dtype=np.int32)
    for number in np.unique(selection.view[selection.view >= 0]):
        photo = photos[number]
        photo.material = materials.photo_material(photo.name, photo.image, photo.material, uv_map)
        materials.write_gain(photo.material, selection.gain[number])
        # Faces across a panorama's seam go on beyond its frame.
        materials.write_repeating(photo.material, full_turn(read_camera(photo)) > 0)
        slots[number] = len(mesh.materials)
        mesh.materials.append(photo.material)
    return slots


def _photo_sizes(photos: list[FrescoPhoto]) -> FloatArray:
    """Width and height of every photo, and (1, 1) for the number -1."""
    cameras = [read_camera(photo) for photo in photos]  # asking the images for their size would load them
    return np.array([(camera.width, camera.height) for camera in cameras] + [(1, 1)], dtype=np.float64)


def photo_uvs(selection: Selection, photos: list[FrescoPhoto]) -> FloatArray:
    """Blender's UVs (F,3,2) of a selection; 0 where no photo sees the face."""
    size = _photo_sizes(photos)[selection.view]
    uvs = materials.uvs_from_pixels(selection.uv, size[:, None, 0], size[:, None, 1])
    uvs[selection.view < 0] = 0.0
    return uvs


def read_layers(scene: bpy.types.Scene) -> dict[str, TexturedScan]:
    """Return all layers of the scan by their names. Raises TextureError when there is none."""
    return {layer: read_texture(scene, layer) for layer in layer_names(scene.fresco.scan) or [""]}


def read_texture(scene: bpy.types.Scene, layer: str | None = None) -> TexturedScan:
    """Return a layer, or the one that the scan shows, as core takes it. Raises TextureError without one."""
    obj, photos = scene.fresco.scan, scene.fresco.photos
    layer = scene.fresco.layer if layer is None else layer
    mesh = obj.data
    values = {field: meshes.read_face_attribute(mesh, attribute_name(field, layer)) for field in MAPS}
    names = json.loads(mesh.get(PHOTOS_KEY + layer, "[]"))
    missing = [name for name in names if name not in photos]
    if missing:
        raise TextureError(f"Photo {missing[0]} was removed since the scan was textured: texture it again.")
    bare = any(value is None for value in values.values()) or uv_name(layer) not in mesh.uv_layers
    if not names or bare:
        raise TextureError("The scan has no texture yet: texture it first (step 6).")
    items = [photos[name] for name in names]
    uvs = meshes.read_uvs(mesh, uv_name(layer))
    size = _photo_sizes(items)[values["view"]]
    pixels = materials.pixels_from_uvs(uvs, size[:, None, 0], size[:, None, 1])
    pixels[values["view"] < 0] = 0.0
    faces = meshes.read_faces(mesh)
    numbers = {name: np.array(value) for name, value in json.loads(mesh[NUMBERS_KEY + layer]).items()}
    return TexturedScan(
        vertices=meshes.read_vertices(obj),
        faces=faces,
        parent=np.arange(len(faces), dtype=np.int32),
        selection=Selection(uv=pixels, **numbers, **values),
        views=tuple(read_view(scene, item) for item in items),
    )


def read_gains(scene: bpy.types.Scene) -> dict[str, FloatArray]:
    """Linear factors (3,) of the photos in use, by the name of their material; none without a texture."""
    mesh = scene.fresco.scan.data
    found: dict[str, FloatArray] = {}
    for layer in layer_names(scene.fresco.scan):
        gains = np.array(json.loads(mesh[NUMBERS_KEY + layer])["gain"], dtype=np.float64)
        items = [scene.fresco.photos.get(name) for name in json.loads(mesh[PHOTOS_KEY + layer])]
        for item, gain in zip(items, gains, strict=True):
            if item is not None and item.material is not None:
                found[item.material.name] = gain
    return found


def texture_rows(textured: TexturedScan) -> list[tuple[str, str]]:
    """Numbers of a texture for the panel: names and values."""
    selection = textured.selection
    seen = selection.view >= 0
    rows = [
        ("Covered", f"{100 * textured.coverage:.1f} % of the surface"),
        ("Photos", f"{len(np.unique(selection.view[seen]))} in use"),
        ("Faces", f"{np.count_nonzero(seen):,} of {len(seen):,}"),
    ]
    if seen.any():
        rows.append(("Texel", f"{1000 * float(np.nanmedian(selection.texel_size)):.2f} mm (median)"))
    added = len(seen) - len(np.unique(textured.parent))
    if added:
        rows.append(("Split", f"{added:,} faces added: large ones cut"))
    return rows
