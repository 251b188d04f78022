"""Regions between the scene and core: faces as attributes of the scan, marks as mask images of photos."""

from __future__ import annotations

import colorsys
from collections.abc import Mapping

import bpy
import numpy as np

from ...core.arrays import ArrayLike, BoolArray
from ...core.photos import RegionMark
from ...core.regions import ImageRegion
from ..properties import FrescoPhoto, FrescoRegion
from . import meshes
from .images import load_mask, pack_mask

_GOLDEN_RATIO = 0.618033988749895  # turns of the hue circle: neighbours in the list differ most


def add_region(scene: bpy.types.Scene, name: str) -> FrescoRegion:
    """Add a region without faces or marks; a taken name gets a number."""
    fresco = scene.fresco
    uid = fresco.next_region
    fresco.next_region += 1
    region = fresco.regions.add()
    region.uid = uid
    region.name = _unique_name(fresco, name)
    region.color = colorsys.hsv_to_rgb((0.05 + uid * _GOLDEN_RATIO) % 1.0, 0.65, 0.95)
    fresco.region_index = len(fresco.regions) - 1
    return region


def _unique_name(fresco: object, name: str) -> str:
    number, unique = 2, name
    while fresco.region_named(unique) is not None:
        number, unique = number + 1, f"{name} {number}"
    return unique


def named_region(scene: bpy.types.Scene, name: str) -> FrescoRegion:
    """Return the region of that name, made where it is missing."""
    return scene.fresco.region_named(name) or add_region(scene, name)


def write_faces(scene: bpy.types.Scene, region: FrescoRegion, inside: BoolArray) -> None:
    """Set the faces (F,) of a region on the scan."""
    meshes.write_face_attribute(scene.fresco.scan.data, region.attribute, inside)
    region.face_count = int(np.count_nonzero(inside))


def write_face_set(scene: bpy.types.Scene, region: FrescoRegion, faces: ArrayLike) -> None:
    """Set the faces of a region by their numbers."""
    inside = np.zeros(len(scene.fresco.scan.data.polygons), dtype=np.bool_)
    inside[np.asarray(faces, dtype=np.int64)] = True
    write_faces(scene, region, inside)


def write_face_sets(scene: bpy.types.Scene, face_sets: Mapping[str, ArrayLike]) -> None:
    """Make regions of named face sets, (n,) face numbers each; the other regions lose their faces."""
    for name, faces in face_sets.items():
        write_face_set(scene, named_region(scene, name), faces)
    count_faces(scene)


def read_faces(scene: bpy.types.Scene, region: FrescoRegion) -> BoolArray:
    """Return the faces (F,) of a region; all false where it has none."""
    mesh = scene.fresco.scan.data
    inside = meshes.read_face_attribute(mesh, region.attribute)
    return np.zeros(len(mesh.polygons), dtype=np.bool_) if inside is None else inside


def count_faces(scene: bpy.types.Scene) -> None:
    """Count the faces of all regions again, after the scan was edited or replaced."""
    for region in scene.fresco.regions:
        region.face_count = int(np.count_nonzero(read_faces(scene, region))) if scene.fresco.scan else 0


def remove_region(scene: bpy.types.Scene, index: int) -> None:
    """Take a region out of the list, off the scan and out of all photos."""
    fresco = scene.fresco
    region = fresco.regions[index]
    if fresco.scan is not None:
        meshes.remove_attribute(fresco.scan.data, region.attribute)
    for photo in fresco.photos:
        remove_mark(photo, region)
    fresco.regions.remove(index)
    fresco.region_index = max(0, min(fresco.region_index, len(fresco.regions) - 1))


def write_mark(photo: FrescoPhoto, region: FrescoRegion, mark: RegionMark, size: tuple[int, int]) -> None:
    """Mark a region in a photo of `size` (width, height), in place of an earlier mark.

    A mask file is shown itself; a polygon or array is kept as a mask in the .blend.
    """
    if mark.path is not None:
        image = load_mask(mark.path.resolve())
    else:
        image = pack_mask(f"{photo.name} {region.name}", mark_pixels(mark, size))
    item = photo.mark(region.uid) or photo.marks.add()
    item.region_id = region.uid
    item.image = image


def mark_pixels(mark: RegionMark, size: tuple[int, int]) -> BoolArray:
    """Mask (H,W) of a mark."""
    mask = mark.read_mask(*size)
    if mask is None:
        mask = ImageRegion.from_polygon(mark.outline, mark.holes, mark.name).to_mask(*size)
    return mask


def remove_mark(photo: FrescoPhoto, region: FrescoRegion) -> None:
    """Remove the mark of a region from a photo, if there is one."""
    for index in reversed(range(len(photo.marks))):
        if photo.marks[index].region_id == region.uid:
            photo.marks.remove(index)
