"""Regions between the scene and core: faces as attributes of the scan, marks as mask images of photos."""

from __future__ import annotations

import colorsys
import json
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import bpy
import numpy as np

from ...core.arrays import ArrayLike, BoolArray, FloatArray, IndexArray, IntArray
from ...core.errors import RegionError
from ...core.photos import RegionMark
from ...core.regions import ImageRegion, SurfaceRegion
from ...core.regions.surface_files import FaceRegion, found_again, kept_regions
from ..properties import FrescoPhoto, FrescoRegion
from . import meshes
from .images import load_mask, pack_mask
from .world import matrix_to_array, read_offset

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
    region.revision = secrets.randbits(31)
    region.opening_json = ""


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
        region.revision = secrets.randbits(31)


def keep_faces(scene: bpy.types.Scene) -> list[FaceRegion]:
    """Remember where the faces of all regions lie, in true coordinates; by the regions' names.

    None are remembered of a mesh with faces of more than three corners: core does not know such regions.
    """
    scan = scene.fresco.scan
    if scan is None or not meshes.is_triangulated(scan.data):
        return []
    chosen = [(r.name, np.flatnonzero(read_faces(scene, r))) for r in scene.fresco.regions]
    corners = meshes.read_vertices(scan) + read_offset(scene)
    return kept_regions(corners, meshes.read_faces(scan.data), [pair for pair in chosen if len(pair[1])])


def restore_faces(scene: bpy.types.Scene, kept: Sequence[FaceRegion]) -> list[str]:
    """Give regions that a new scan does not have itself the faces that lie where theirs were.

    Returns a sentence for every region that is not there.
    """
    bare = [region for region in kept if not scene.fresco.region_named(region.name).is_on_scan]
    if not bare:
        return []
    scan, lost = scene.fresco.scan, []
    corners, triangles = meshes.read_vertices(scan) + read_offset(scene), meshes.read_faces(scan.data)
    for region in bare:
        try:
            faces = found_again(region, corners, triangles)
        except RegionError as error:
            lost.append(str(error))
        else:
            write_face_set(scene, scene.fresco.region_named(region.name), faces)
    return lost


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


def duplicate_region(scene: bpy.types.Scene, region: FrescoRegion) -> FrescoRegion:
    """Add a region with the same faces and marks as another."""
    index = list(scene.fresco.regions).index(region)
    copy = add_region(scene, region.name)
    region = scene.fresco.regions[index]  # adding may have moved it
    if scene.fresco.scan is not None and region.face_count:
        write_faces(scene, copy, read_faces(scene, region))
    copy.opening_json = region.opening_json
    for photo in scene.fresco.photos:
        mark = photo.mark(region.uid)
        if mark is not None:
            item = photo.marks.add()
            item.region_id, item.image, item.hidden = copy.uid, mark.image, mark.hidden
    return copy


def merge_regions(scene: bpy.types.Scene, on_scan: FrescoRegion, in_photos: FrescoRegion) -> None:
    """Give a region of the scan the marks of another one, which are of the same patch.

    A photo that marks both keeps both, and then the other region stays in the list.
    """
    fresco = scene.fresco
    kept = False
    for photo in fresco.photos:
        mark = photo.mark(in_photos.uid)
        if mark is None:
            continue
        if photo.mark(on_scan.uid) is None:
            mark.region_id = on_scan.uid
        else:
            kept = True
    chosen = on_scan.uid
    if not kept and not in_photos.is_on_scan:
        remove_region(scene, list(fresco.regions).index(in_photos))
    fresco.region_index = next(k for k, region in enumerate(fresco.regions) if region.uid == chosen)


def region_of(scene: bpy.types.Scene, uid: int) -> FrescoRegion | None:
    """Return the region of that number."""
    return next((region for region in scene.fresco.regions if region.uid == uid), None)


def opening_to_json(scan: bpy.types.Object, surface: SurfaceRegion) -> str:
    """Keep the surface (Blender's world, metres) that spans an opening, in the scan object's frame."""
    corners = meshes.to_object_frame(scan, surface.vertices)
    return json.dumps({"corners": corners.tolist(), "triangles": surface.faces.tolist()})


def write_opening(scene: bpy.types.Scene, region: FrescoRegion, surface: SurfaceRegion) -> None:
    """Make a region an opening, given in Blender's world, metres."""
    region.opening_json = opening_to_json(scene.fresco.scan, surface)
    region.revision = secrets.randbits(31)


def read_opening(scene: bpy.types.Scene, region: FrescoRegion) -> tuple[FloatArray, IndexArray]:
    """Corners (n,3) in Blender's world, metres, and triangles (m,3) of a region that is an opening."""
    return opening_in_world(scene.fresco.scan, region.opening_json)


def opening_in_world(scan: bpy.types.Object, opening_json: str) -> tuple[FloatArray, IndexArray]:
    """Corners (n,3) in Blender's world, metres, and triangles (m,3) of an opening as it is kept."""
    content = json.loads(opening_json)
    matrix = matrix_to_array(scan.matrix_world)
    corners = np.array(content["corners"]) @ matrix[:3, :3].T + matrix[:3, 3]
    return corners, np.array(content["triangles"], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class SurfaceSource:
    """The scan (vertices (V,3) m in Blender's world, faces (F,3)) and what regions take of it.

    Taken out of Blender so that threads can make `SurfaceRegion`s; `openings` are corners and triangles.
    """

    vertices: FloatArray
    faces: IntArray
    inside: Mapping[str, BoolArray]
    openings: Mapping[str, tuple[FloatArray, IndexArray]]

    def regions(self) -> dict[str, SurfaceRegion]:
        """Return core's regions by name, each with its own vertices."""
        surfaces = {name: SurfaceRegion(*shape, name) for name, shape in self.openings.items()}
        for name, inside in self.inside.items():
            used, corners = np.unique(self.faces[inside].ravel(), return_inverse=True)
            surfaces[name] = SurfaceRegion(self.vertices[used], corners.reshape(-1, 3), name)
        return surfaces


def surface_source(scene: bpy.types.Scene) -> SurfaceSource:
    """Take the scan and its regions out of Blender."""
    scan = scene.fresco.scan
    inside, openings = {}, {}
    for region in scene.fresco.regions:
        if region.opening_json:
            openings[region.name] = read_opening(scene, region)
            continue
        faces = read_faces(scene, region)
        if faces.any():
            inside[region.name] = faces
    return SurfaceSource(meshes.read_vertices(scan), meshes.read_faces(scan.data), inside, openings)


def read_surfaces(scene: bpy.types.Scene) -> dict[str, SurfaceRegion]:
    """Return core's regions of the scan by name, in Blender's world, metres."""
    return surface_source(scene).regions()


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
    hidden = mark.read_hidden(*size)
    if hidden is not None:
        write_hidden(photo, region, hidden)


def write_hidden(photo: FrescoPhoto, region: FrescoRegion, hidden: BoolArray) -> None:
    """Keep a mask (H,W) of what stands before a region that is marked in a photo; an empty one is dropped."""
    mark = photo.mark(region.uid)
    mark.hidden = pack_mask(f"{photo.name} {region.name} hidden", hidden) if hidden.any() else None


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
