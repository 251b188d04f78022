"""Points: the table of surveyed points, where the chosen photo shows them, and how well they fit."""

from __future__ import annotations

import bpy

from ..properties import FrescoPoint, FrescoScene
from ..settings import draw_settings
from .base import FrescoPanel, draw_text


class FRESCO_UL_points(bpy.types.UIList):
    """Points: name, active or not, residual in the chosen photo."""

    bl_idname = "FRESCO_UL_points"

    def draw_item(
        self,
        context: bpy.types.Context,
        layout: bpy.types.UILayout,
        data: FrescoScene,
        item: FrescoPoint,
        icon: int,
        active_data: object,
        active_property: str,
        index: int,
    ) -> None:
        row = layout.row(align=True)
        photo = data.active_photo
        pick = photo.picks.get(item.name) if photo is not None else None
        tick = row.row()
        if pick is not None:
            tick.prop(pick, "active", text="")
        else:
            tick.label(text="", icon="BLANK1")
        row.prop(item, "name", text="", emboss=False)
        right = row.row()
        right.alignment = "RIGHT"
        if pick is None:
            right.active = False
            right.label(text="not picked")
        elif pick.residual < 0:
            right.label(text=f"{pick.pixel[0]:.1f}, {pick.pixel[1]:.1f}")
        elif not pick.active:
            right.active = False
            right.label(text=f"{pick.residual:.2f} px  check")
        else:
            right.alert = not pick.used
            right.label(text=f"{pick.residual:.2f} px" + ("" if pick.used else "  wrong"))


class FRESCO_PT_points(FrescoPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_points"
    bl_parent_id = "FRESCO_PT_pose"
    bl_label = "Points"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, fresco = self.layout, context.scene.fresco
        row = layout.row(align=True)
        row.operator("fresco.import_points", icon="IMPORT")
        row.operator("fresco.pick_on_scan", text="", icon="CURSOR")
        if not fresco.points:
            draw_text(layout, context, "Import surveyed points, or pick some on the scan.", icon="INFO")
            return
        row = layout.row()
        row.template_list("FRESCO_UL_points", "", fresco, "points", fresco, "point_index", rows=5)
        row.operator("fresco.remove_point", text="", icon="REMOVE")
        point = fresco.active_point
        if point is not None:
            column = layout.column()
            column.prop(point, "place", text="")
            column.operator("fresco.pick_in_photo", icon="EYEDROPPER")
        layout.operator_menu_enum("fresco.find_markers", "kind", icon="VIEWZOOM")
        layout.operator("fresco.pose_from_points", icon="CON_CAMERASOLVER")


class FRESCO_PT_points_settings(FrescoPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_points_settings"
    bl_parent_id = "FRESCO_PT_points"
    bl_label = "Settings"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        draw_settings(self.layout, context.scene.fresco.point_settings)


CLASSES = (FRESCO_UL_points, FRESCO_PT_points, FRESCO_PT_points_settings)
