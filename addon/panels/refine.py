"""Step 5: the poses made more exact."""

from __future__ import annotations

from statistics import median

import bpy
import numpy as np

from ...core.project import Refinement
from ..bridge.photos import read_solution
from ..operators.refine import refinable_photos
from ..overlays.residuals import edges_of, ties_of
from ..properties import FrescoPhoto
from ..settings import draw_settings
from .base import FrescoPanel, StepPanel, draw_rows, draw_text
from .photos import format_length

NAMES = {"edges": "Edges", "joint": "Together"}


class FRESCO_PT_refine(StepPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_refine"
    bl_label = "5  Refine"
    bl_order = 5
    step = "refine"

    @classmethod
    def is_done(cls, context: bpy.types.Context) -> bool:
        photos = [photo for photo in refinable_photos(context.scene) if not photo.hold]
        return bool(photos) and all(photo.is_refined for photo in photos)

    @classmethod
    def is_ready(cls, context: bpy.types.Context) -> bool:
        return bpy.ops.fresco.refine_edges.poll()

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        row = layout.row(align=True)
        row.operator("fresco.refine_edges", icon="MOD_EDGESPLIT").only_active = False
        row.operator("fresco.refine_edges", text="", icon="RESTRICT_VIEW_OFF").only_active = True
        layout.operator("fresco.refine_jointly", icon="CON_TRACKTO")
        layout.prop(context.scene.fresco.compare, "lenses")
        photos = refinable_photos(context.scene)
        if any(photo.is_refined for photo in photos):
            draw_summary(layout, photos)
        photo = context.scene.fresco.active_photo
        if photo is not None and photo in photos:
            draw_refinements(layout, context, photo)


def draw_summary(layout: bpy.types.UILayout, photos: list[FrescoPhoto]) -> None:
    """Show how many photos were refined and how well they agree."""
    rows = [("Refined", f"{sum(photo.is_refined for photo in photos)} of {len(photos)} photos")]
    shifts = [photo.joint_shift for photo in photos if photo.joint_shift >= 0]
    if shifts:
        rows.append(("Agree to", f"{median(shifts):.1f} px (median)"))
    sigmas = [photo.centre_sigma for photo in photos if photo.is_refined]
    if sigmas:
        rows.append(("Position", f"± {format_length(median(sigmas))} (median)"))
    draw_rows(layout, rows)


def draw_refinements(layout: bpy.types.UILayout, context: bpy.types.Context, photo: FrescoPhoto) -> None:
    """Show what each refinement of the chosen photo did, and what lets one judge it."""
    box = layout.box()
    head = box.row()
    head.label(text=photo.name, icon="CAMERA_DATA")
    head.prop(photo, "hold")
    if photo.is_refined:
        steps = read_solution(context.scene, photo).refinements
        draw_rows(box, [(NAMES[step.method], describe(step)) for step in steps])
        ties = [step.count for step in steps if step.method == "joint" and step.moved]
        if ties:
            draw_rows(box, [("Held by", f"{ties[-1]:,} ties to other photos")])
        for note in [step.note for step in steps if step.note]:
            draw_text(box, context, note, icon="INFO")
        if photo.centre_sigma > 0:
            sigma = f"± {format_length(photo.centre_sigma)}, ± {photo.rotation_sigma:.3f}°"
            draw_rows(box, [("Pose", sigma)])
        box.operator("fresco.restore_pose", icon="LOOP_BACK")
    box.operator("fresco.show_residuals", icon="OVERLAY")
    compare = context.scene.fresco.compare
    ties = ties_of(context.scene, photo)
    if ties is not None:
        row = box.row()
        row.prop(compare, "ties")
        row.prop(compare, "scale", text="×")
        off = float(np.median(np.linalg.norm(ties.offsets, axis=1)))
        draw_rows(box, [("Ties", f"{off:.1f} px off (median)")])
    found = edges_of(photo)
    if found is None:
        return
    box.prop(compare, "blend", slider=True)
    row = box.row(heading="Show")
    row.prop(compare, "edges")
    row = box.row()
    row.prop(compare, "residuals")
    scale = row.row()
    scale.active = compare.residuals
    scale.prop(compare, "scale", text="×")
    medians = [residuals.median for residuals in found.residuals]
    draw_rows(box, [("Residual", "{:.1f} → {:.1f} px (median)".format(*medians))])


def describe(step: Refinement) -> str:
    """Return in a few words what a refinement did."""
    if not step.moved:
        return "kept"
    unit = " px" if step.method == "joint" else ""
    return f"{step.score_before:.2f} → {step.score_after:.2f}{unit}"


class FRESCO_PT_refine_settings(FrescoPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_refine_settings"
    bl_parent_id = "FRESCO_PT_refine"
    bl_label = "Settings"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        fresco = context.scene.fresco
        self.layout.label(text="By edges")
        draw_settings(self.layout, fresco.edges)
        self.layout.label(text="All together")
        draw_settings(self.layout, fresco.joint)


CLASSES = (FRESCO_PT_refine, FRESCO_PT_refine_settings)
