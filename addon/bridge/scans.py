"""Scans between Blender's objects and core."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ...core.arrays import IntArray
from ...core.scans import Scan
from . import meshes, regions
from .colours import read_scan_colours, write_scan_colours
from .world import collection, find_collection, read_offset, write_offset

COLLECTION = "Scan"
OCCLUDERS = "Occluders"


def show_scan(
    context: bpy.types.Context, scan: Scan, region_faces: Mapping[str, IntArray], lost: Sequence[str] = ()
) -> bpy.types.Object:
    """Make the scene's scan object from core's scan, a mesh without faces from a cloud.

    `region_faces` are the faces or points of regions, `lost` sentences on regions that it does not have.
    """
    fresco = context.scene.fresco
    obj = bpy.data.objects.new(
        scan.name or "Scan", meshes.build_mesh(scan.name or "Scan", scan.vertices, scan.faces)
    )
    write_scan_colours(obj.data, scan.vertex_colors, scan.intensity)
    if scan.is_cloud:
        obj.display_type = "BOUNDS"  # Blender would draw all points in one colour; the overlay draws them
    collection(context.scene, COLLECTION).objects.link(obj)
    write_offset(context.scene, scan.offset)
    fresco.scan = obj
    fresco.scan_path = str(scan.path or "")
    fresco.texture_report = fresco.texture_warnings = ""
    regions.write_face_sets(context.scene, region_faces)
    fresco.scan_report = "\n".join([*scan.report, *lost])
    context.view_layer.objects.active = obj
    return obj


def show_occluders(context: bpy.types.Context, occluders: Sequence[Scan]) -> None:
    """Put meshes that only hide the scan into their collection; they have the offset of the scan."""
    for occluder in occluders:
        mesh = meshes.build_mesh(occluder.name, occluder.vertices, occluder.faces)
        obj = bpy.data.objects.new(occluder.name, mesh)
        obj.display_type = "WIRE"
        collection(context.scene, OCCLUDERS).objects.link(obj)


def occluder_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return the mesh objects in the collection of occluders."""
    found = find_collection(scene, OCCLUDERS)
    objects = found.objects if found is not None else ()
    return [obj for obj in objects if obj.type == "MESH" and obj != scene.fresco.scan]


def read_occluders(scene: bpy.types.Scene) -> list[Scan]:
    """Return what only hides the scan, as core takes it."""
    return [_as_scan(scene, obj, meshes.read_triangles(obj.data)) for obj in occluder_objects(scene)]


def read_scan(scene: bpy.types.Scene) -> Scan:
    """Return core's scan from the scene's scan object, in the place and size that it has in the scene."""
    path = Path(scene.fresco.scan_path) if scene.fresco.scan_path else None
    obj = scene.fresco.scan
    colours, intensity = read_scan_colours(obj.data)
    plain = _as_scan(scene, obj, meshes.read_any_faces(obj.data), read_face_sets(scene), path)
    return replace(plain, vertex_colors=colours, intensity=intensity)


def _as_scan(
    scene: bpy.types.Scene,
    obj: bpy.types.Object,
    faces: IntArray,
    face_sets: Mapping[str, IntArray] | None = None,
    path: Path | None = None,
) -> Scan:
    return Scan(
        vertices=meshes.read_vertices(obj),
        faces=faces,
        offset=read_offset(scene),
        file_faces=np.arange(len(faces), dtype=np.int32),
        file_face_count=len(faces),
        name=obj.name,
        path=path,
        face_sets=face_sets or {},
    )


def read_face_sets(scene: bpy.types.Scene) -> dict[str, IntArray]:
    """Return the faces (of a cloud the points) of every region that has some, by the region's name."""
    sets = {}
    for region in scene.fresco.regions:
        inside = meshes.read_element_attribute(scene.fresco.scan.data, region.attribute)
        if inside is not None and inside.any():
            sets[region.name] = np.flatnonzero(inside).astype(np.int32)
    return sets
