"""Bring a scan into the scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
from mathutils import Vector

from ...core.arrays import IntArray
from ...core.jobs import Job, part
from ...core.scans import READERS, Scan, read_scan_job
from ...core.settings import ScanSettings
from ..background import beside_job, one_step_job
from ..bridge.regions import KeptScan, keep_scan
from ..bridge.scans import OCCLUDERS, show_scan
from ..bridge.world import collection
from ..jobs import JobOperator, StepOperator
from ..settings import draw_settings, to_core

ENDINGS = tuple(sorted(READERS))


class FRESCO_OT_import_scan(JobOperator):
    bl_idname = "fresco.import_scan"
    bl_label = "Import Scan"
    bl_description = "Read a scan and check it; large coordinates keep their offset in double precision"
    bl_options = {"UNDO"}
    step = "scan"

    filepath: bpy.props.StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: bpy.props.StringProperty(default=";".join(f"*{e}" for e in ENDINGS), options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.filepath:  # dropped into the window
            return super().invoke(context, event)
        return self.choose_file(context)

    def draw(self, context: bpy.types.Context) -> None:
        draw_settings(self.layout, context.scene.fresco.scan_settings)

    def start(self, context: bpy.types.Context) -> Job[Any]:
        settings = to_core(context.scene.fresco.scan_settings, ScanSettings)
        path = Path(bpy.path.abspath(self.filepath))
        return imported_job(read_scan_job(path, settings), keep_scan(context.scene))

    def finish(self, context: bpy.types.Context, result: ImportedScan) -> None:
        scan = show_scan(context, result.scan, result.regions, result.lost)
        show_only(context, scan)


@dataclass(frozen=True, eq=False)
class ImportedScan:
    """A scan, the faces or points of regions on it, and sentences on those that it does not have."""

    scan: Scan
    regions: Mapping[str, IntArray]
    lost: Sequence[str] = ()


def imported_job(reading: Job[Scan], kept: KeptScan | None) -> Job[ImportedScan]:
    """Read a scan, and find the regions of the one before on it."""
    if kept is None:
        scan = yield from reading
        return ImportedScan(scan, scan.face_sets)
    scan = yield from part(reading, 0.0, 0.8)
    job = one_step_job(lambda: kept.found_in(scan), "Finding the regions again")
    found, lost = yield from part(beside_job(job), 0.8, 1.0)
    return ImportedScan(scan, {**found, **scan.face_sets}, lost)


def show_only(context: bpy.types.Context, scan: bpy.types.Object) -> None:
    """Select just the scan and turn the 3D view to it."""
    for obj in context.selected_objects:
        obj.select_set(False)
    scan.select_set(True)
    context.view_layer.objects.active = scan
    context.view_layer.update()
    space = context.space_data
    if space is not None and space.type == "VIEW_3D":
        corners = [scan.matrix_world @ Vector(corner) for corner in scan.bound_box]
        size = (corners[6] - corners[0]).length
        space.clip_end = max(space.clip_end, 20 * size)
        space.region_3d.view_perspective = "PERSP"
        space.region_3d.view_location = (corners[0] + corners[6]) / 2
        space.region_3d.view_distance = 1.2 * size


class FRESCO_OT_add_occluders(StepOperator):
    bl_idname = "fresco.add_occluders"
    bl_label = "Add Occluders"
    bl_description = (
        "Selected meshes hide the scan from the cameras, but get no texture: furniture, scaffolds"
    )
    bl_options = {"UNDO"}
    step = "scan"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("Select meshes that stand before the scan")
        return any(is_occluder(context, obj) for obj in context.selected_objects)

    def run(self, context: bpy.types.Context) -> None:
        target = collection(context.scene, OCCLUDERS)
        chosen = [obj for obj in context.selected_objects if is_occluder(context, obj)]
        for obj in chosen:
            if obj.name not in target.objects:
                target.objects.link(obj)
        self.report({"INFO"}, f"{len(chosen)} objects hide the scan from now on")


def is_occluder(context: bpy.types.Context, obj: bpy.types.Object) -> bool:
    """Whether an object can hide the scan: another mesh."""
    return obj.type == "MESH" and obj != context.scene.fresco.scan


class FRESCO_FH_scan(bpy.types.FileHandler):
    bl_idname = "FRESCO_FH_scan"
    bl_label = "Fresco scan"
    bl_import_operator = "fresco.import_scan"
    bl_file_extensions = ";".join(ENDINGS)

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return context.area is not None and context.area.type == "VIEW_3D"


CLASSES = (FRESCO_OT_import_scan, FRESCO_OT_add_occluders, FRESCO_FH_scan)
