"""Step 1: the scan."""

from __future__ import annotations

import bpy

from ..bridge.meshes import is_cloud
from ..bridge.scans import occluder_objects
from ..bridge.world import read_offset
from .base import StepPanel, draw_rows, draw_text


class FRESCO_PT_scan(StepPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_scan"
    bl_label = "1  Scan"
    bl_order = 1
    step = "scan"

    @classmethod
    def is_done(cls, context: bpy.types.Context) -> bool:
        return context.scene.fresco.scan is not None

    @classmethod
    def is_ready(cls, context: bpy.types.Context) -> bool:
        return True

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        fresco = context.scene.fresco
        row = layout.row(align=True)
        row.operator("fresco.import_scan", icon="IMPORT")
        row.operator("fresco.open_project", text="", icon="FILE_FOLDER")
        row.operator("fresco.save_project", text="", icon="FILE_TICK")
        column = layout.column()
        column.prop(fresco, "scan", text="")
        if fresco.scan is None:
            draw_text(column, context, "Import a scan, or choose a mesh of this scene.", icon="INFO")
            return
        draw_numbers(layout, context, fresco.scan)
        layout.prop(fresco.scan_settings, "epsg")
        row = layout.row()
        row.label(text=f"{len(occluder_objects(context.scene))} occluders", icon="MOD_BOOLEAN")
        row.operator("fresco.add_occluders", text="Add Selected", icon="ADD")
        for line in fresco.scan_report.splitlines():
            draw_text(layout, context, line, icon="INFO")


def draw_numbers(layout: bpy.types.UILayout, context: bpy.types.Context, scan: bpy.types.Object) -> None:
    """Show how large the scan is and where it stands."""
    size = " × ".join(f"{length:.2f}" for length in scan.dimensions)
    vertices = f"{len(scan.data.vertices):,}"
    if is_cloud(scan.data):
        rows = [("Points", vertices)]
    else:
        rows = [("Faces", f"{len(scan.data.polygons):,}"), ("Vertices", vertices)]
    rows.append(("Size", f"{size} m"))
    offset = read_offset(context.scene)
    if offset.any():
        rows.append(("Offset", ", ".join(f"{value:,.0f}" for value in offset) + " m"))
    draw_rows(layout, rows)


CLASSES = (FRESCO_PT_scan,)
