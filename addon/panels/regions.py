"""Step 3: the regions, patches that are seen both on the scan and in photos; in 3D view and Image Editor."""

from __future__ import annotations

import json

import bpy

from ..bridge.meshes import element_name
from ..operators.mending import shown_mark_photo
from ..operators.proposals import worked_photo
from ..properties import FrescoRegion, FrescoScene
from ..tools.settings import FrescoMarking, FrescoProposal
from ..tools.toolbar import PHOTO_TOOLS
from .base import StepPanel, draw_error, draw_text

HOW_TO_MARK = (
    "Mark patches that scan and photos both show: one click with the wand in the photo (Image Editor) and "
    "one on the scan (3D view), or let them be proposed."
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
        faces.alert = not item.is_on_scan
        on_scan = "MOD_BOOLEAN" if item.opening_json else "MESH_DATA"
        faces.label(text="", icon=on_scan if item.is_on_scan else "ERROR")
        count = marked_photos(data, item)
        marks = row.row()
        marks.alert = count == 0
        marks.alignment = "RIGHT"
        marks.label(text=str(count), icon="IMAGE_DATA")


class FRESCO_UL_proposals(bpy.types.UIList):
    """Proposals: kind, name, size or score."""

    bl_idname = "FRESCO_UL_proposals"

    def draw_item(
        self,
        context: bpy.types.Context,
        layout: bpy.types.UILayout,
        data: FrescoMarking,
        item: FrescoProposal,
        icon: int,
        active_data: object,
        active_property: str,
        index: int,
    ) -> None:
        split = layout.split(factor=0.5)
        split.label(text=item.name, icon=item.bl_rna.properties["kind"].enum_items[item.kind].icon)
        note = split.row()
        note.active = False
        note.label(text=item.note)


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
        return any(r.is_on_scan and marked_photos(fresco, r) > 0 for r in fresco.regions)

    @classmethod
    def is_ready(cls, context: bpy.types.Context) -> bool:
        fresco = context.scene.fresco
        return fresco.scan is not None and len(fresco.photos) > 0

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        fresco = context.scene.fresco
        column = layout.column(align=True)
        row = column.row(align=True)
        row.operator("fresco.region_from_selection", icon="FACESEL")
        row.operator_menu_enum("fresco.region_from_group", "source", text="", icon="GROUP_VERTEX")
        row = column.row(align=True)
        row.operator("fresco.import_masks", icon="IMAGE_DATA")
        row.operator("fresco.import_mask_folder", text="", icon="FILE_FOLDER")
        if not fresco.regions:
            draw_text(layout, context, HOW_TO_MARK, icon="INFO")
            return
        draw_list(layout, fresco)
        draw_region(layout, context, fresco)


class FRESCO_PT_regions_photo(bpy.types.Panel):
    bl_idname = "FRESCO_PT_regions_photo"
    bl_label = "Regions"
    bl_space_type = "IMAGE_EDITOR"
    bl_region_type = "UI"
    bl_category = "Fresco"
    bl_order = 1

    def draw(self, context: bpy.types.Context) -> None:
        layout, fresco = self.layout, context.scene.fresco
        draw_error(layout, context, "regions")
        if worked_photo(context) is None:
            draw_text(layout, context, "Show an imported photo here, to mark regions in it.", icon="INFO")
            return
        draw_tool(layout, context)
        if not fresco.regions:
            draw_text(layout, context, HOW_TO_MARK, icon="INFO")
            return
        draw_list(layout, fresco)
        draw_region(layout, context, fresco)


def draw_tool(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw the settings of the marking tool in use: the Image Editor's own header for them is closed."""
    active = context.workspace.tools.from_space_image_mode("VIEW", create=False)
    tool = next((t for t in PHOTO_TOOLS if active is not None and t.bl_idname == active.idname), None)
    if tool is None:
        draw_text(layout, context, "Choose a Region tool in the toolbar (key T) to mark.", icon="INFO")
        return
    column = layout.column()
    column.label(text=tool.bl_label, icon="TOOL_SETTINGS")
    tool.draw_settings(context, column, active)


def draw_list(layout: bpy.types.UILayout, fresco: FrescoScene) -> None:
    """Draw the list of regions with its buttons."""
    row = layout.row()
    row.template_list("FRESCO_UL_regions", "", fresco, "regions", fresco, "region_index", rows=5)
    side = row.column(align=True)
    side.operator("fresco.remove_region", text="", icon="REMOVE")
    side.operator("fresco.duplicate_region", text="", icon="DUPLICATE")
    side.separator()
    side.operator("fresco.select_region", text="", icon="RESTRICT_SELECT_OFF")
    side.operator("fresco.replace_region", text="", icon="FILE_REFRESH")


def draw_region(layout: bpy.types.UILayout, context: bpy.types.Context, fresco: FrescoScene) -> None:
    """Say what the chosen region still misses and in which photos it is marked; mend it."""
    region = fresco.active_region
    if region is None:
        return
    if not region.is_on_scan:
        draw_text(layout, context, "Not on the scan yet: click it with the Surface Wand.", icon="ERROR")
    elif region.opening_json:
        draw_text(layout, context, "An opening of the scan", icon="MOD_BOOLEAN")
    else:
        row = layout.row(align=True)
        row.label(text=f"{region.face_count:,} {element_name(fresco.scan.data)}", icon="MESH_DATA")
        row.operator_menu_enum("fresco.tidy_faces", "action", text="Mend Faces")
    marked = [photo.name for photo in fresco.photos if photo.mark(region.uid) is not None]
    if marked:
        draw_text(layout, context, "Marked in " + ", ".join(marked), icon="IMAGE_DATA")
    else:
        draw_text(layout, context, "In no photo yet: click it there with the Region Wand.", icon="ERROR")
    draw_mark(layout, context, region)


def draw_mark(layout: bpy.types.UILayout, context: bpy.types.Context, region: FrescoRegion) -> None:
    """Draw what can be done with the chosen region's mark in the photo."""
    photo = shown_mark_photo(context)
    if photo is None:
        return
    column = layout.column(align=True)
    row = column.row(align=True)
    row.operator_menu_enum("fresco.tidy_mark", "action", text="Mend Outline")
    row.prop(context.scene.fresco_marking, "grow", text="")
    if photo.mark(region.uid).hidden is not None:
        column.operator("fresco.clear_hidden", icon="HIDE_OFF")
    column.operator("fresco.remove_mask", icon="X", text=f"Remove Its Mark in {photo.name}")


class AdvicePanel:
    """Mixin: how good the marked regions are, and how sure the pose will be."""

    bl_label = "Quality"

    def draw(self, context: bpy.types.Context) -> None:
        layout, told = self.layout, context.window_manager.fresco_advice
        photo = context.scene.fresco.active_photo
        if photo is None or not photo.camera_json:
            draw_text(layout, context, "Choose a photo with a calibrated camera in step 2.", icon="INFO")
            return
        column = layout.column()
        column.active = not told.working and told.photo == photo.name
        if told.pose:
            draw_text(column, context, f"{told.photo}: {told.pose}", icon="CAMERA_DATA")
        for name, quality in json.loads(told.regions_json or "{}").items():
            draw_quality(column, context, name, quality)
        if told.working:
            layout.label(text="Looking…", icon="SORTTIME")


def draw_quality(
    layout: bpy.types.UILayout, context: bpy.types.Context, name: str, quality: dict[str, object]
) -> None:
    """Draw one region's size, compactness and symmetry, and what they mean."""
    region = context.scene.fresco.region_named(name)
    row = layout.row(align=True)
    if region is not None:
        swatch = row.row()
        swatch.ui_units_x = 0.9
        swatch.prop(region, "color", text="")
    row.label(text=name)
    turns = {0: "round", 1: "no symmetry"}.get(quality["symmetry"], f"{quality['symmetry']}-fold symmetry")
    figures = f"{quality['area']:,.0f} px², compactness {quality['compactness']:.2f}, {turns}"
    draw_text(layout, context, figures, icon="BLANK1")
    if quality["advice"]:
        draw_text(layout, context, str(quality["advice"]), icon="ERROR")


class FRESCO_PT_advice(AdvicePanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_advice"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Fresco"
    bl_parent_id = "FRESCO_PT_regions"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 1


class FRESCO_PT_advice_photo(AdvicePanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_advice_photo"
    bl_space_type = "IMAGE_EDITOR"
    bl_region_type = "UI"
    bl_category = "Fresco"
    bl_order = 2


class ProposalsPanel:
    """Mixin: regions, marks and partners that were found, to accept or refuse."""

    bl_label = "Proposals"

    def draw(self, context: bpy.types.Context) -> None:
        layout, marking = self.layout, context.scene.fresco_marking
        column = layout.column(align=True)
        row = column.row(align=True)
        row.operator("fresco.propose_surface", text="Scan", icon="MESH_PLANE")
        row.operator("fresco.propose_photo", text="Photo", icon="IMAGE_DATA")
        row = column.row(align=True)
        row.operator("fresco.propose_partners", icon="LINKED")
        row.operator_menu_enum("fresco.propose_partners", "guide", text="", icon="DOWNARROW_HLT")
        column.operator_menu_enum("fresco.transfer_regions", "rough", icon="UV_SYNC_SELECT")
        if not marking.proposals:
            return
        row = layout.row()
        row.template_list("FRESCO_UL_proposals", "", marking, "proposals", marking, "proposal_index", rows=5)
        side = row.column(align=True)
        side.operator("fresco.accept_proposal", text="", icon="CHECKMARK")
        side.operator("fresco.discard_proposal", text="", icon="X")
        side.separator()
        side.operator("fresco.select_proposal", text="", icon="RESTRICT_SELECT_OFF")
        draw_proposal(layout, context, marking.active_proposal)
        row = layout.row(align=True)
        row.operator("fresco.accept_all_proposals")
        row.operator("fresco.discard_all_proposals")


def draw_proposal(
    layout: bpy.types.UILayout, context: bpy.types.Context, proposal: FrescoProposal | None
) -> None:
    """Say what accepting the chosen proposal means."""
    if proposal is None:
        return
    if proposal.kind == "PARTNERS":
        draw_text(layout, context, f"{proposal.photo}: {proposal.name} ({proposal.note})", icon="LINKED")
    elif proposal.kind == "TRANSFER":
        draw_text(layout, context, f"Marks {proposal.name} in {proposal.note}")
    else:
        draw_text(layout, context, f"Makes a region {proposal.name}, {proposal.note}")


class FRESCO_PT_proposals(ProposalsPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_proposals"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Fresco"
    bl_parent_id = "FRESCO_PT_regions"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 2


class FRESCO_PT_proposals_photo(ProposalsPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_proposals_photo"
    bl_space_type = "IMAGE_EDITOR"
    bl_region_type = "UI"
    bl_category = "Fresco"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 3


CLASSES = (
    FRESCO_UL_regions,
    FRESCO_UL_proposals,
    FRESCO_PT_regions,
    FRESCO_PT_advice,
    FRESCO_PT_proposals,
    FRESCO_PT_regions_photo,
    FRESCO_PT_advice_photo,
    FRESCO_PT_proposals_photo,
)
