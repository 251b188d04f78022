"""Step 4: the poses."""

from __future__ import annotations

from statistics import median

import bpy

from ..bridge.photos import is_moved, read_candidates
from ..properties import FrescoPhoto
from .base import SettingsPanel, StepPanel, draw_rows, draw_text
from .photos import STATE_ICONS, format_length


class FRESCO_PT_pose(StepPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_pose"
    bl_label = "4  Pose"
    bl_order = 4
    step = "pose"

    @classmethod
    def is_done(cls, context: bpy.types.Context) -> bool:
        photos = [photo for photo in context.scene.fresco.photos if photo.use]
        return bool(photos) and all(photo.is_posed for photo in photos)

    @classmethod
    def is_ready(cls, context: bpy.types.Context) -> bool:
        return bpy.ops.fresco.solve_poses.poll()

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        fresco = context.scene.fresco
        row = layout.row(align=True)
        row.operator("fresco.solve_poses", icon="CON_CAMERASOLVER").only_active = False
        row.operator("fresco.solve_poses", text="", icon="RESTRICT_VIEW_OFF").only_active = True
        photos = [photo for photo in fresco.photos if photo.use]
        if any(photo.state != "UNSOLVED" for photo in photos):
            draw_summary(layout, photos)
        if fresco.active_photo is not None:
            draw_pose(layout, context, fresco.active_photo)


def draw_summary(layout: bpy.types.UILayout, photos: list[FrescoPhoto]) -> None:
    """Show how many photos are solved and how well."""
    solved = [photo for photo in photos if photo.state == "SOLVED"]
    rows = [("Posed", f"{sum(photo.is_posed for photo in photos)} of {len(photos)} photos")]
    if solved:
        overlaps = [photo.overlap for photo in solved if photo.overlap >= 0]
        if overlaps:
            rows.append(("Overlap", f"{median(overlaps):.2f} % error (median)"))
        rows.append(("Position", f"± {format_length(median(p.centre_sigma for p in solved))} (median)"))
    draw_rows(layout, rows)


def draw_pose(layout: bpy.types.UILayout, context: bpy.types.Context, photo: FrescoPhoto) -> None:
    """Show the pose of the chosen photo, or why there is none."""
    box = layout.box()
    state = photo.bl_rna.properties["state"].enum_items[photo.state].name
    head = box.row()
    head.label(text=photo.name, icon="CAMERA_DATA")
    right = head.row()
    right.alignment = "RIGHT"
    right.alert = photo.state in {"FAILED", "AMBIGUOUS"}
    right.label(text=state, icon=STATE_ICONS[photo.state])
    if photo.state in {"SOLVED", "AMBIGUOUS"}:
        rows = [
            ("Position", f"± {format_length(photo.centre_sigma)}"),
            ("Rotation", f"± {photo.rotation_sigma:.3f}°"),
        ]
        if photo.overlap >= 0:  # a pose from points has none
            rows.insert(0, ("Overlap", f"{photo.overlap:.2f} % error"))
        draw_rows(box, rows)
    if photo.message:
        draw_text(box, context, photo.message, icon="INFO")
    candidates = read_candidates(photo) if photo.state == "AMBIGUOUS" else []
    if len(candidates) > 1:
        text = f"Candidate {photo.candidate + 1} of {len(candidates)}: Show Next"
        box.operator("fresco.next_candidate", text=text, icon="FILE_REFRESH")
    if photo.state in {"AMBIGUOUS", "FAILED", "UNSOLVED"} or is_moved(context.scene, photo):
        if photo.state in {"SOLVED", "GIVEN"}:
            draw_text(box, context, "Its camera was moved since.", icon="INFO")
        found = photo.state in {"AMBIGUOUS", "SOLVED"}
        box.operator(
            "fresco.accept_pose", text="Accept Pose" if found else "Use Camera as Placed", icon="PINNED"
        )


class FRESCO_PT_pose_settings(SettingsPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_pose_settings"
    bl_parent_id = "FRESCO_PT_pose"
    group = "pose"


CLASSES = (FRESCO_PT_pose, FRESCO_PT_pose_settings)
