"""The texture on Blender's mesh: UVs into the original photos, a material per photo, maps as attributes."""

from __future__ import annotations

import dataclasses
import json

import bpy
import numpy as np

from ...core.arrays import FloatArray, IntArray
from ...core.errors import TextureError
from ...core.project import TexturedScan
from ...core.texture import Selection
from ...core.texture.images import full_turn
from ..properties import FrescoPhoto
from . import materials, meshes
from .photos import read_camera, read_view
from .regions import count_faces

PHOTOS_KEY = "fresco_photos"
"""ID property of the mesh: the names of the photos that the maps count, as JSON."""
NUMBERS_KEY = "fresco_texture"
"""ID property of the mesh: what a selection says of every photo, as JSON."""
MAPS = ("view", "runner_up", "view_count", "texel_size", "angle", "blur")
"""Fields of core's selection with one value per face: kept as face attributes "fresco_FIELD"."""


def attribute_name(field: str) -> str:
    """Name of the face attribute that keeps a field of the selection."""
    return f"fresco_{field}"


def _photo_fields() -> list[str]:
    """Fields of core's selection with one entry per photo."""
    return [field.name for field in dataclasses.fields(Selection) if field.name not in {*MAPS, "uv"}]


def show_texture(scene: bpy.types.Scene, textured: TexturedScan, photos: list[FrescoPhoto]) -> None:
    """Lay a texture on the scene's scan and keep its numbers; `photos` are those that it counts."""
    write_texture(scene.fresco.scan, textured, photos)
    count_faces(scene)
    scene.fresco.texture_report = "\n".join("\t".join(row) for row in texture_rows(textured))
    scene.fresco.texture_warnings = "\n".join(textured.selection.warnings)


def write_texture(scan: bpy.types.Object, textured: TexturedScan, photos: list[FrescoPhoto]) -> None:
    """Show a texture on the scan: geometry where faces were split, materials, UVs, maps.

    `photos` are those that `textured.selection` counts.
    """
    mesh, selection = scan.data, textured.selection
    if len(textured.faces) != len(mesh.polygons):
        refine_mesh(scan, textured)
    slots = write_slots(mesh, selection, photos)
    meshes.write_material_indices(mesh, slots[selection.view])  # the last slot stands for -1
    meshes.write_uvs(mesh, materials.UV_MAP, photo_uvs(selection, photos))
    mesh[PHOTOS_KEY] = json.dumps([photo.name for photo in photos])
    mesh[NUMBERS_KEY] = json.dumps({name: getattr(selection, name).tolist() for name in _photo_fields()})
    for field in MAPS:
        meshes.write_face_attribute(mesh, attribute_name(field), getattr(selection, field))


def refine_mesh(scan: bpy.types.Object, textured: TexturedScan) -> None:
    """Replace the scan's mesh by its refined one; every new face inherits its parent's attributes."""
    mesh = scan.data
    names = [n for n in meshes.face_attribute_names(mesh) if not n.startswith(".") and n != "material_index"]
    kept = {name: meshes.read_face_attribute(mesh, name) for name in names}
    meshes.fill_mesh(mesh, meshes.to_object_frame(scan, textured.vertices), textured.faces)
    for name, values in kept.items():
        if values is not None:
            meshes.write_face_attribute(mesh, name, values[textured.parent])


def write_slots(mesh: bpy.types.Mesh, selection: Selection, photos: list[FrescoPhoto]) -> IntArray:
    """Give the mesh one slot per photo in use and a neutral one; -> slot of every photo, neutral last."""
    unseen = materials.unseen_material()
    slots = np.zeros(len(photos) + 1, dtype=np.int32)
    mesh.materials.clear()
    mesh.materials.append(unseen)
    for number in np.unique(selection.view[selection.view >= 0]):
        photo = photos[number]
        photo.material = materials.photo_material(photo.name, photo.image, photo.material)
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


def read_texture(scene: bpy.types.Scene) -> TexturedScan:
    """Return the texture that the scan shows, as core takes it. Raises TextureError when there is none."""
    obj, photos = scene.fresco.scan, scene.fresco.photos
    mesh = obj.data
    values = {field: meshes.read_face_attribute(mesh, attribute_name(field)) for field in MAPS}
    names = json.loads(mesh.get(PHOTOS_KEY, "[]"))
    missing = [name for name in names if name not in photos]
    if missing:
        raise TextureError(f"Photo {missing[0]} was removed since the scan was textured: texture it again.")
    if not names or any(value is None for value in values.values()) or materials.UV_MAP not in mesh.uv_layers:
        raise TextureError("The scan has no texture yet: texture it first (step 6).")
    items = [photos[name] for name in names]
    uvs = meshes.read_uvs(mesh, materials.UV_MAP)
    size = _photo_sizes(items)[values["view"]]
    pixels = materials.pixels_from_uvs(uvs, size[:, None, 0], size[:, None, 1])
    pixels[values["view"] < 0] = 0.0
    faces = meshes.read_faces(mesh)
    return TexturedScan(
        vertices=meshes.read_vertices(obj),
        faces=faces,
        parent=np.arange(len(faces), dtype=np.int32),
        selection=Selection(
            uv=pixels,
            **{name: np.array(numbers) for name, numbers in json.loads(mesh[NUMBERS_KEY]).items()},
            **values,
        ),
        views=tuple(read_view(scene, item) for item in items),
    )


def read_gains(scene: bpy.types.Scene) -> dict[str, FloatArray]:
    """Linear factors (3,) of the photos in use, by the name of their material; none without a texture."""
    mesh = scene.fresco.scan.data
    if NUMBERS_KEY not in mesh:
        return {}
    gains = np.array(json.loads(mesh[NUMBERS_KEY])["gain"], dtype=np.float64)
    items = [scene.fresco.photos.get(name) for name in json.loads(mesh[PHOTOS_KEY])]
    return {
        item.material.name: gain
        for item, gain in zip(items, gains, strict=True)
        if item is not None and item.material is not None
    }


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
