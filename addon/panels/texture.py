"""Step 5: the texture."""

from __future__ import annotations

import bpy

from ..bridge.meshes import is_cloud
from .base import SettingsPanel, StepPanel, draw_rows, draw_text


class FRESCO_PT_texture(StepPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_texture"
    bl_label = "6  Texture"
    bl_order = 6
    step = "texture"

    @classmethod
    def is_done(cls, context: bpy.types.Context) -> bool:
        return bool(context.scene.fresco.texture_report)

    @classmethod
    def is_ready(cls, context: bpy.types.Context) -> bool:
        return bpy.ops.fresco.texture_scan.poll()

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        row = layout.row(align=True)
        scan = context.scene.fresco.scan
        if scan is not None and is_cloud(scan.data):
            row.operator("fresco.texture_scan", icon="TEXTURE", text="Colour Points")
        else:
            row.operator("fresco.texture_scan", icon="TEXTURE")
            row.operator("fresco.show_texture", text="", icon="SHADING_TEXTURE").equalised = False
            row.operator("fresco.show_texture", text="", icon="SHADING_RENDERED").equalised = True
        rows = [line.split("\t") for line in context.scene.fresco.texture_report.splitlines()]
        draw_rows(layout, [(name, value) for name, value in rows])
        for sentence in context.scene.fresco.texture_warnings.splitlines():
            draw_text(layout, context, sentence, icon="ERROR")


class FRESCO_PT_texture_settings(SettingsPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_texture_settings"
    bl_parent_id = "FRESCO_PT_texture"
    group = "texture"


CLASSES = (FRESCO_PT_texture, FRESCO_PT_texture_settings)
