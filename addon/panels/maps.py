"""Maps of the texture, layers, and what they say about the next photos."""

from __future__ import annotations

import bpy

from ..bridge.maps import read_legend
from ..bridge.texture import layer_names
from .base import FrescoPanel, draw_rows


class FRESCO_PT_maps(FrescoPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_maps"
    bl_parent_id = "FRESCO_PT_texture"
    bl_label = "Maps"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(context.scene.fresco.texture_report)

    def draw(self, context: bpy.types.Context) -> None:
        layout, maps = self.layout, context.scene.fresco.maps
        layout.use_property_split = True
        layout.use_property_decorate = False
        names = layer_names(context.scene.fresco.scan)
        if len(names) > 1:
            shown = context.scene.fresco.layer or "without a name"
            layout.operator("fresco.next_layer", text=f"Layer {shown}: Next", icon="RENDERLAYERS")
        layout.operator_menu_enum("fresco.show_map", "field", text="Show Map", icon="COLOR")
        legend = read_legend(context.scene)
        if legend is not None:
            rows = [("Shown", legend["title"])]
            if legend["scale"]:
                rows.append(("From, to", "  –  ".join(legend["ends"])))
            draw_rows(layout, rows)
        column = layout.column()
        column.prop(maps, "wanted_texel")
        column.prop(maps, "count")
        layout.operator("fresco.next_standpoints", icon="OUTLINER_OB_CAMERA")
        draw_rows(layout, [tuple(line.split("\t")) for line in maps.coverage.splitlines()])


CLASSES = (FRESCO_PT_maps,)
