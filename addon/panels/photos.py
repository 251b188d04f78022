"""Step 2: the photos and their cameras."""

from __future__ import annotations

import bpy

from ..properties import PHOTO_STATES, FrescoPhoto
from .base import StepPanel, draw_rows, draw_text

STATE_ICONS = {identifier: icon for identifier, _, _, icon, _ in PHOTO_STATES}


class FRESCO_UL_photos(bpy.types.UIList):
    """Photos: used or not, state, name, numbers of the pose."""

    bl_idname = "FRESCO_UL_photos"

    def draw_item(
        self,
        context: bpy.types.Context,
        layout: bpy.types.UILayout,
        data: object,
        item: FrescoPhoto,
        icon: int,
        active_data: object,
        active_property: str,
        index: int,
    ) -> None:
        layout.use_property_split = False
        row = layout.row(align=True)
        row.prop(item, "use", text="")
        body = row.row(align=True)
        body.active = item.use
        body.label(text=item.name, icon=STATE_ICONS[item.state])
        numbers = body.row(align=True)
        numbers.alignment = "RIGHT"
        numbers.label(text=pose_numbers(item))


def pose_numbers(photo: FrescoPhoto) -> str:
    """Overlap error and uncertainty as the list shows them: 0.4 %  3 mm."""
    if photo.state not in {"SOLVED", "AMBIGUOUS"}:
        return ""
    overlap = f"{photo.overlap:.1f} %  " if photo.overlap >= 0 else ""  # a pose from points has none
    return f"{overlap}{format_length(photo.centre_sigma)}"


def format_length(metres: float) -> str:
    """Return a length as a surveyor reads it: 0.4 mm, 3 mm, 25 cm, 1.2 m."""
    if metres < 0.1:
        return f"{1000 * metres:.1f} mm" if metres < 0.001 else f"{1000 * metres:.0f} mm"
    return f"{100 * metres:.0f} cm" if metres < 1 else f"{metres:.1f} m"


class FRESCO_PT_photos(StepPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_photos"
    bl_label = "2  Photos"
    bl_order = 2
    step = "photos"

    @classmethod
    def is_done(cls, context: bpy.types.Context) -> bool:
        photos = context.scene.fresco.photos
        return len(photos) > 0 and all(photo.camera_json for photo in photos)

    @classmethod
    def is_ready(cls, context: bpy.types.Context) -> bool:
        return True

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        fresco = context.scene.fresco
        row = layout.row(align=True)
        row.operator("fresco.import_photos", icon="IMPORT")
        row.operator("fresco.import_photo_folder", text="", icon="FILE_FOLDER")
        if not fresco.photos:
            draw_text(layout, context, "Import the photographs of the scanned object.", icon="INFO")
            return
        row = layout.row()
        row.template_list("FRESCO_UL_photos", "", fresco, "photos", fresco, "photo_index", rows=5)
        column = row.column(align=True)
        column.operator("fresco.remove_photo", text="", icon="REMOVE")
        column.separator()
        column.operator("fresco.look_through", text="", icon="VIEW_CAMERA")
        column.operator("fresco.set_calibration", text="", icon="CAMERA_DATA")
        column.separator()
        column.operator("fresco.import_cameras", text="", icon="IMPORT")
        column.operator("fresco.export_cameras", text="", icon="EXPORT")
        if fresco.active_photo is not None:
            draw_photo(layout, context, fresco.active_photo)


def draw_photo(layout: bpy.types.UILayout, context: bpy.types.Context, photo: FrescoPhoto) -> None:
    """Show the calibration of the chosen photo and how its background is drawn."""
    if photo.camera is None:
        draw_text(
            layout, context, "Its camera was deleted: remove this photo and import it again.", icon="ERROR"
        )
        return
    if not photo.camera_json:
        draw_text(layout, context, photo.camera_source, icon="ERROR")
        layout.operator("fresco.set_calibration", icon="CAMERA_DATA")
        return
    width, height = photo.size
    lens = f"{photo.camera.data.lens:.1f} mm (full frame)"
    draw_rows(layout, [("Size", f"{width} × {height} px"), ("Lens", lens)])
    draw_text(layout, context, photo.camera_source, icon="CAMERA_DATA")
    if photo.place_told:
        draw_text(layout, context, photo.place_told, icon="WORLD")
    layout.prop(photo, "use_texture")
    row = layout.column()
    row.active = photo.use_texture
    row.prop(photo, "priority")
    row.prop(photo, "layer")
    for background in photo.camera.data.background_images[:1]:
        layout.prop(background, "alpha", text="Photo opacity", slider=True)
        layout.prop(background, "display_depth", text="Photo depth", expand=True)


CLASSES = (FRESCO_UL_photos, FRESCO_PT_photos)
