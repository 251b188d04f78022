"""Deliver: what is written, and where."""

from __future__ import annotations

import bpy

from ..settings import draw_settings
from .base import FrescoPanel, draw_error


class FRESCO_PT_export(FrescoPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_export"
    bl_label = "Export"
    bl_order = 7

    def draw_header(self, context: bpy.types.Context) -> None:
        self.layout.label(text="", icon="EXPORT")

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        draw_error(layout, context, "export")
        export = context.scene.fresco.export
        layout.prop(export, "folder")
        layout.prop(export, "name", placeholder=export.default_name(context.scene))
        column = layout.column(heading="Write")
        for name in ("write_glb", "write_obj", "write_report", "write_blend"):
            column.prop(export, name)
        layout.operator("fresco.export", icon="EXPORT")


class FRESCO_PT_delivery(FrescoPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_delivery"
    bl_parent_id = "FRESCO_PT_export"
    bl_label = "Atlas and Vertex Colours"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, fresco = self.layout, context.scene.fresco
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column()
        column.prop(fresco.delivery, "level")
        column.prop(fresco.delivery, "untouched")
        layout.operator("fresco.bake_atlas", icon="UV")
        layout.operator("fresco.colour_vertices", icon="GROUP_VCOL")
        draw_settings(layout, fresco.atlas)


CLASSES = (FRESCO_PT_export, FRESCO_PT_delivery)
