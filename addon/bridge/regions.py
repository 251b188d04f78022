"""Regions between the scene and core: faces as attributes of the scan, marks as mask images of photos."""

from __future__ import annotations

import colorsys
import json
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import bpy
import numpy as np

from ...core.arrays import ArrayLike, BoolArray, FloatArray, IndexArray, IntArray
from ...core.errors import RegionError
from ...core.photos import RegionMark
from ...core.regions import ImageRegion, SurfaceRegion
from ...core.regions.surface.cloud_region import cloud_region, found_points
from ...core.regions.surface.files import FaceRegion, found_again, kept_regions
from ...core.scans import Scan
from ..properties import FrescoPhoto, FrescoRegion
from . import meshes
from .images import encode_mask, load_mask, pack_mask
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
    """Set the faces (F,) of a region on the scan; of a point cloud, here and below, its points."""
    meshes.write_element_attribute(scene.fresco.scan.data, region.attribute, inside)
    region.face_count = int(np.count_nonzero(inside))
    region.revision = secrets.randbits(31)
    region.opening_json = ""


def write_face_set(scene: bpy.types.Scene, region: FrescoRegion, faces: ArrayLike) -> None:
    """Set the faces of a region by their numbers."""
    inside = np.zeros(meshes.element_count(scene.fresco.scan.data), dtype=np.bool_)
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
    inside = meshes.read_element_attribute(mesh, region.attribute)
    return np.zeros(meshes.element_count(mesh), dtype=np.bool_) if inside is None else inside


def count_faces(scene: bpy.types.Scene) -> None:
    """Count the faces of all regions again, after the scan was edited or replaced."""
    for region in scene.fresco.regions:
        region.face_count = int(np.count_nonzero(read_faces(scene, region))) if scene.fresco.scan else 0
        region.revision = secrets.randbits(31)


@dataclass(frozen=True, eq=False)
class KeptScan:
    """A scan in true coordinates, (V,3) m and (F,3), and the faces or points (n,) of its regions by name.

    Taken out of Blender, so that a thread can find the regions on another scan.
    """

    vertices: FloatArray
    faces: IntArray
    chosen: Sequence[tuple[str, IndexArray]]

    def face_regions(self) -> list[FaceRegion]:
        """Where the regions lie, as a project keeps it; none of a point cloud."""
        return kept_regions(self.vertices, self.faces, self.chosen) if len(self.faces) else []

    def point_labels(self) -> dict[str, BoolArray]:
        """Which points (V,) of a cloud belong to each region; none of a mesh."""
        return {} if len(self.faces) else {name: self._mask(chosen) for name, chosen in self.chosen}

    def _mask(self, chosen: IndexArray) -> BoolArray:
        inside = np.zeros(len(self.vertices), dtype=np.bool_)
        inside[chosen] = True
        return inside

    def found_in(self, scan: Scan) -> tuple[dict[str, IndexArray], list[str]]:
        """Faces or points of the regions in a new scan, and a sentence for every one that is not there.

        Regions that the new scan brings itself are left out.
        """
        vertices, found, lost = scan.vertices + scan.offset, {}, []
        bare = [(name, chosen) for name, chosen in self.chosen if name not in scan.face_sets]
        if bare and scan.is_cloud != (len(self.faces) == 0):
            return {}, [
                f"Region '{name}' was marked on another kind of scan: mark it anew." for name, _ in bare
            ]
        if scan.is_cloud:
            searches = [
                (name, partial(found_points, self.vertices[chosen], vertices, name)) for name, chosen in bare
            ]
        else:
            kept = kept_regions(self.vertices, self.faces, bare)
            searches = [(region.name, partial(found_again, region, vertices, scan.faces)) for region in kept]
        for name, search in searches:
            try:
                found[name] = search()
            except RegionError as error:
                lost.append(str(error))
        return found, lost


def keep_scan(scene: bpy.types.Scene) -> KeptScan | None:
    """Take scan and regions out of Blender; None without a scan, or of one whose faces are no triangles."""
    scan = scene.fresco.scan
    if scan is None or not meshes.is_triangulated(scan.data):
        return None
    chosen = [(r.name, np.flatnonzero(read_faces(scene, r))) for r in scene.fresco.regions]
    corners = meshes.read_vertices(scan) + read_offset(scene)
    return KeptScan(corners, meshes.read_any_faces(scan.data), [pair for pair in chosen if len(pair[1])])


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


def patch(vertices: FloatArray, faces: IntArray, inside: BoolArray, name: str) -> SurfaceRegion:
    """Region of a mesh (V,3) m, (F,3) that has the faces `inside` (F,); of points (V,) where it has none.

    Raises RegionError where points have no outline.
    """
    if len(faces) == 0:
        return cloud_region(vertices[inside], name)
    used, corners = np.unique(faces[inside].ravel(), return_inverse=True)
    return SurfaceRegion(vertices[used], corners.reshape(-1, 3), name)


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
            surfaces[name] = patch(self.vertices, self.faces, inside, name)
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
    return SurfaceSource(meshes.read_vertices(scan), meshes.read_any_faces(scan.data), inside, openings)


def write_mark(photo: FrescoPhoto, region: FrescoRegion, mark: RegionMark, size: tuple[int, int]) -> None:
    """Mark a region in a photo of `size` (width, height), in place of an earlier mark.

    A mask file is shown itself; a polygon or array is kept as a mask in the .blend.
    """
    if mark.path is not None:
        _set_mark(photo, region, load_mask(mark.path.resolve()))
    else:
        write_encoded_mark(photo, region, encode_mask(mark_pixels(mark, size)))
    hidden = mark.read_hidden(*size)
    if hidden is not None:
        write_hidden(photo, region, hidden)


def write_encoded_mark(photo: FrescoPhoto, region: FrescoRegion, encoded: bytes) -> None:
    """Mark a region in a photo by a mask's PNG, in place of an earlier mark."""
    _set_mark(photo, region, pack_mask(f"{photo.name} {region.name}", encoded))


def _set_mark(photo: FrescoPhoto, region: FrescoRegion, image: bpy.types.Image) -> None:
    item = photo.mark(region.uid) or photo.marks.add()
    item.region_id, item.image = region.uid, image


def write_hidden(photo: FrescoPhoto, region: FrescoRegion, hidden: BoolArray) -> None:
    """Keep a mask (H,W) of what stands before a region that is marked in a photo; an empty one is dropped."""
    mark = photo.mark(region.uid)
    name = f"{photo.name} {region.name} hidden"
    mark.hidden = pack_mask(name, encode_mask(hidden)) if hidden.any() else None


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
