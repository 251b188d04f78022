"""Deliver: what is written, and where."""

from __future__ import annotations

import bpy

from ..bridge.delivery import SIMPLIFIED_KEY, simplified_objects
from ..settings import draw_settings
from .base import FrescoPanel, draw_error, draw_text


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
        row = layout.row(align=True)
        row.operator("fresco.find_colour_chart", icon="COLOR")
        row.operator("fresco.forget_colour_chart", text="", icon="X")
        if fresco.delivery.chart_told:
            draw_text(layout, context, fresco.delivery.chart_told)
        draw_settings(layout, fresco.atlas)


class FRESCO_PT_simplify(FrescoPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_simplify"
    bl_parent_id = "FRESCO_PT_export"
    bl_label = "Simplified Model"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, delivery = self.layout, context.scene.fresco.delivery
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(delivery, "simplify_by")
        by_faces = delivery.simplify_by == "FACES"
        layout.prop(delivery, "simplify_faces" if by_faces else "simplify_tolerance")
        layout.operator("fresco.simplify_model", icon="MOD_DECIM")
        for obj in simplified_objects(context.scene):
            draw_text(layout, context, f"{obj.name}: {obj[SIMPLIFIED_KEY]}")


CLASSES = (FRESCO_PT_export, FRESCO_PT_delivery, FRESCO_PT_simplify)
