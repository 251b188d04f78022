"""The tools in the toolbars of Image Editor and 3D view: icons, keys, cursors, settings in the header."""

from __future__ import annotations

import bpy
import numpy as np

from ..overlays.lines import circle, draw_loops
from . import targets

Keymap = tuple[tuple[str, dict[str, object], dict[str, object] | None], ...]
_PALE = (0.9, 0.9, 0.9)


def strokes(operator: str, *keys: tuple[str, dict[str, object], dict[str, object] | None]) -> Keymap:
    """Left button with and without the keys that add and take away, and other keys."""
    kinds = ({}, {"shift": True}, {"ctrl": True})
    return (*((operator, {"type": "LEFTMOUSE", "value": "PRESS", **kind}, None) for kind in kinds), *keys)


WAND_KEYS = tuple(
    ("fresco.wand_step", {"type": key, "value": "PRESS"}, {"properties": [("steps", steps)]})
    for key, steps in (
        ("NUMPAD_PLUS", 1), ("EQUAL", 1), ("PLUS", 1), ("NUMPAD_MINUS", -1), ("MINUS", -1),
    )
)  # fmt: skip
BRUSH_KEYS = (
    (
        "wm.radial_control",
        {"type": "F", "value": "PRESS"},
        {"properties": [("data_path_primary", "scene.fresco_marking.radius")]},
    ),
)


def draw_brush(_context: bpy.types.Context, _tool: object, place: tuple[int, int]) -> None:
    """Show the brush's size at the mouse."""
    radius = bpy.context.scene.fresco_marking.radius
    draw_loops([circle(np.array(place, dtype=np.float64), radius)], _PALE, width=1.0)


class PhotoTool(bpy.types.WorkSpaceTool):
    """Base of the Image Editor's tools."""

    bl_space_type = "IMAGE_EDITOR"
    bl_context_mode = "VIEW"
    bl_cursor = "CROSSHAIR"

    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: object) -> None:
        draw_photo_target(context, layout)


class DrawnTool(PhotoTool):
    """Base of tools whose outline can be moved onto the photo's edges."""

    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: object) -> None:
        draw_snapping(context, layout)
        draw_photo_target(context, layout)


class ScanTool(bpy.types.WorkSpaceTool):
    """Base of the 3D view's tools."""

    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_cursor = "CROSSHAIR"

    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: object) -> None:
        draw_scan_target(context, layout)


class FRESCO_TOOL_photo_wand(PhotoTool):
    bl_idname = "fresco.tool_photo_wand"
    bl_label = "Region Wand"
    bl_description = (
        "One click marks a region of the photo; drag, or press plus and minus, for a larger or smaller one"
    )
    bl_icon = "ops.paint.weight_fill"
    bl_keymap = strokes("fresco.photo_wand", *WAND_KEYS)
    bl_cursor = "EYEDROPPER"

    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: object) -> None:
        layout.prop(context.scene.fresco_marking, "kind")
        draw_photo_target(context, layout)


class FRESCO_TOOL_photo_polygon(DrawnTool):
    bl_idname = "fresco.tool_photo_polygon"
    bl_label = "Region Polygon"
    bl_description = "Mark a region corner by corner"
    bl_icon = "ops.mesh.polybuild_hover"
    bl_keymap = strokes("fresco.photo_polygon")


class FRESCO_TOOL_photo_lasso(DrawnTool):
    bl_idname = "fresco.tool_photo_lasso"
    bl_label = "Region Lasso"
    bl_description = "Draw around a region"
    bl_icon = "ops.generic.select_lasso"
    bl_keymap = strokes("fresco.photo_lasso")


class FRESCO_TOOL_photo_brush(PhotoTool):
    bl_idname = "fresco.tool_photo_brush"
    bl_label = "Region Brush"
    bl_description = "Paint a region, or take away from it with Ctrl; F changes the radius"
    bl_icon = "ops.generic.select_circle"
    bl_keymap = strokes("fresco.photo_brush", *BRUSH_KEYS)
    bl_cursor = "PAINT_CROSS"

    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: object) -> None:
        layout.prop(context.scene.fresco_marking, "radius")
        draw_photo_target(context, layout)

    draw_cursor = draw_brush


class FRESCO_TOOL_photo_grabcut(PhotoTool):
    bl_idname = "fresco.tool_photo_grabcut"
    bl_label = "Region GrabCut"
    bl_description = "Draw roughly around a region; the rest is found by its colours"
    bl_icon = "ops.mesh.knife_tool"
    bl_keymap = strokes("fresco.photo_grabcut")


class FRESCO_TOOL_scan_wand(ScanTool):
    bl_idname = "fresco.tool_scan_wand"
    bl_label = "Surface Wand"
    bl_description = (
        "One click marks a smooth part of the scan; drag, or press plus and minus, for another size"
    )
    bl_icon = "ops.paint.weight_fill"
    bl_keymap = strokes("fresco.scan_wand", *WAND_KEYS)
    bl_cursor = "EYEDROPPER"


class FRESCO_TOOL_scan_brush(ScanTool):
    bl_idname = "fresco.tool_scan_brush"
    bl_label = "Surface Brush"
    bl_description = "Paint a region on the scan, or take away from it with Ctrl; F changes the radius"
    bl_icon = "ops.generic.select_circle"
    bl_keymap = strokes("fresco.scan_brush", *BRUSH_KEYS)
    bl_cursor = "PAINT_CROSS"

    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: object) -> None:
        layout.prop(context.scene.fresco_marking, "radius")
        draw_scan_target(context, layout)

    draw_cursor = draw_brush


class FRESCO_TOOL_scan_lasso(ScanTool):
    bl_idname = "fresco.tool_scan_lasso"
    bl_label = "Surface Lasso"
    bl_description = "Draw around a region of the scan"
    bl_icon = "ops.generic.select_lasso"
    bl_keymap = strokes("fresco.scan_lasso")


def draw_snapping(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
    """Draw the settings of moving drawn outlines onto edges."""
    marking = context.scene.fresco_marking
    layout.prop(marking, "snap")
    row = layout.row()
    row.active = marking.snap
    row.prop(marking, "reach")


def draw_photo_target(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
    """Say what the next stroke in the photo marks."""
    marking, region = context.scene.fresco_marking, context.scene.fresco.active_region
    layout.row().prop(marking, "part", expand=True)
    photo = targets.shown_photo(context)
    marked = region is not None and photo is not None and photo.mark(region.uid) is not None
    if marking.part == "REGION":
        draw_target(context, layout, marked)
    else:
        layout.label(text=f"Hides {region.name}" if marked else "Mark the region first")


def draw_scan_target(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
    """Say what the next stroke on the scan marks."""
    region = context.scene.fresco.active_region
    draw_target(context, layout, region is not None and region.is_on_scan)


def draw_target(context: bpy.types.Context, layout: bpy.types.UILayout, taken: bool) -> None:
    """Say which region the next stroke marks."""
    layout.prop(context.scene.fresco_marking, "redo")
    region = targets.stroke_target(context, "replace", taken)
    layout.label(text="Marks a new region" if region is None else f"Marks {region.name}")


PHOTO_TOOLS = (
    FRESCO_TOOL_photo_wand,
    FRESCO_TOOL_photo_polygon,
    FRESCO_TOOL_photo_lasso,
    FRESCO_TOOL_photo_brush,
    FRESCO_TOOL_photo_grabcut,
)
SCAN_TOOLS = (FRESCO_TOOL_scan_wand, FRESCO_TOOL_scan_brush, FRESCO_TOOL_scan_lasso)
