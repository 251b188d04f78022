"""Step 3: the regions, patches that are seen both on the scan and in photos."""

from __future__ import annotations

import bpy

from ..properties import FrescoRegion, FrescoScene
from .base import StepPanel, draw_text

HOW_TO_MARK = (
    "Mark patches that scan and photos both show: select their faces in Edit Mode, and give a mask for "
    "every photo."
)


class FRESCO_UL_regions(bpy.types.UIList):
    """Regions: colour, name, faces on the scan, photos that show them."""

    bl_idname = "FRESCO_UL_regions"

    def draw_item(
        self,
        context: bpy.types.Context,
        layout: bpy.types.UILayout,
        data: FrescoScene,
        item: FrescoRegion,
        icon: int,
        active_data: object,
        active_property: str,
        index: int,
    ) -> None:
        layout.use_property_split = False
        row = layout.row(align=True)
        swatch = row.row()
        swatch.ui_units_x = 0.9
        swatch.prop(item, "color", text="")
        row.prop(item, "name", text="", emboss=False)
        faces = row.row()
        faces.alert = item.face_count == 0
        faces.label(text="", icon="MESH_DATA" if item.face_count else "ERROR")
        count = marked_photos(data, item)
        marks = row.row()
        marks.alert = count == 0
        marks.alignment = "RIGHT"
        marks.label(text=str(count), icon="IMAGE_DATA")


def marked_photos(fresco: FrescoScene, region: FrescoRegion) -> int:
    """Number of photos in which a region is marked."""
    return sum(photo.mark(region.uid) is not None for photo in fresco.photos)


class FRESCO_PT_regions(StepPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_regions"
    bl_label = "3  Regions"
    bl_order = 3
    step = "regions"

    @classmethod
    def is_done(cls, context: bpy.types.Context) -> bool:
        fresco = context.scene.fresco
        return any(r.face_count > 0 and marked_photos(fresco, r) > 0 for r in fresco.regions)

    @classmethod
    def is_ready(cls, context: bpy.types.Context) -> bool:
        fresco = context.scene.fresco
        return fresco.scan is not None and len(fresco.photos) > 0

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        fresco = context.scene.fresco
        column = layout.column(align=True)
        column.operator("fresco.region_from_selection", icon="FACESEL")
        row = column.row(align=True)
        row.operator("fresco.import_masks", icon="IMAGE_DATA")
        row.operator("fresco.import_mask_folder", text="", icon="FILE_FOLDER")
        if not fresco.regions:
            draw_text(layout, context, HOW_TO_MARK, icon="INFO")
            return
        row = layout.row()
        row.template_list("FRESCO_UL_regions", "", fresco, "regions", fresco, "region_index", rows=4)
        side = row.column(align=True)
        side.operator("fresco.remove_region", text="", icon="REMOVE")
        side.separator()
        side.operator("fresco.select_region", text="", icon="RESTRICT_SELECT_OFF")
        side.operator("fresco.replace_region", text="", icon="FILE_REFRESH")
        draw_region(layout, context, fresco)


def draw_region(layout: bpy.types.UILayout, context: bpy.types.Context, fresco: FrescoScene) -> None:
    """Say what the chosen region still misses, and in which photos it is marked."""
    region = fresco.active_region
    if region is None:
        return
    if region.face_count == 0:
        draw_text(
            layout, context, "No faces on the scan yet: select some and press the arrows.", icon="ERROR"
        )
    else:
        draw_text(layout, context, f"{region.face_count:,} faces on the scan", icon="MESH_DATA")
    marked = [photo.name for photo in fresco.photos if photo.mark(region.uid) is not None]
    if marked:
        draw_text(layout, context, "Marked in " + ", ".join(marked), icon="IMAGE_DATA")
    else:
        draw_text(layout, context, "Not marked in any photo yet: load a mask.", icon="ERROR")
    photo = fresco.active_photo
    if photo is not None and photo.mark(region.uid) is not None:
        layout.operator("fresco.remove_mask", icon="X", text=f"Remove Its Mask in {photo.name}")


CLASSES = (FRESCO_UL_regions, FRESCO_PT_regions)
