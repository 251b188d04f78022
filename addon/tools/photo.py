"""Marking regions in the photo that the Image Editor shows."""

from __future__ import annotations

import bpy
import numpy as np

from ...core.arrays import BoolArray, FloatArray
from ...core.errors import RegionError
from ...core.jobs import Job, Progress
from ...core.regions.grabcut import grab_cut
from ...core.regions.outline import (
    brush_mask,
    mask_polygons,
    polygon_mask,
    smoothed_mask,
    without_holes,
    without_specks,
)
from ...core.regions.snap import snap_polygon, snapped_mask_loops
from ...core.regions.wand import PhotoWand
from ..bridge.images import read_mask_pixels
from ..jobs import StepOperator
from ..overlays.lines import circle, draw_loops
from ..properties import FrescoPhoto
from . import targets
from .modal import MarkingOperator
from .prepared import photo_job, read_pixels

PREVIEW = (1.0, 0.85, 0.2)
_STEP = 14  # screen pixels of dragging per level of the wand
_CLOSE = 12  # screen pixels from the first corner at which a click closes a polygon


class PhotoStroke(MarkingOperator):
    """Mixin: a stroke in the Image Editor."""

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("Show an imported photo in the Image Editor")
        return targets.shown_photo(context) is not None

    def place(self, context: bpy.types.Context, event: bpy.types.Event) -> FloatArray:
        """Pixel (u, v) of the photo under the mouse."""
        return targets.to_pixel(context, event.mouse_region_x, event.mouse_region_y, self.size)

    def start(self, context: bpy.types.Context) -> None:
        """Remember the photo: the list may change while the stroke lasts."""
        photo = targets.shown_photo(context)
        self.photo_name, self.size = photo.name, tuple(photo.image.size)

    def target(self, context: bpy.types.Context) -> FrescoPhoto:
        """Return the photo that the stroke began on."""
        photo = context.scene.fresco.photos.get(self.photo_name)
        if photo is None:
            raise RegionError("The photo was removed while it was marked.")
        return photo


class FRESCO_OT_photo_wand(PhotoStroke, bpy.types.Operator):
    bl_idname = "fresco.photo_wand"
    bl_label = "Region Wand"
    bl_description = "Click a region; drag for a smaller or larger one. Shift adds, Ctrl takes away"

    def job(self, context: bpy.types.Context) -> Job[PhotoWand]:
        self.start(context)
        return photo_job(self.target(context))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.mode = targets.stroke_mode(event)
        return super().invoke(context, event)

    def begin(self, context: bpy.types.Context, prepared: PhotoWand) -> None:
        self.wand = prepared
        pixel = targets.to_pixel(context, *self.pressed, self.size)
        self.found = prepared.click(pixel, context.scene.fresco_marking.kind)
        self.level = self.found.level()

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> bool | None:
        if event.type == "MOUSEMOVE" and not self.released:
            self.level = self.found.level(round((event.mouse_region_x - self.pressed[0]) / _STEP))
        return True if self.is_release(event) else None

    def draw_stroke(self) -> None:
        draw_loops([targets.to_region(bpy.context, self.level.outline, self.size)], PREVIEW)

    def apply(self, context: bpy.types.Context) -> None:
        mask = self.wand.mask(self.wand.finished(self.level))
        targets.mark_photo(context, self.target(context), mask, self.mode)


class DrawnStroke(PhotoStroke):
    """Mixin: an outline or line drawn by the mouse, kept in pixels of the photo."""

    closed = True

    def job(self, context: bpy.types.Context) -> Job[None]:
        self.start(context)
        return _nothing_job()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.mode = targets.stroke_mode(event)
        return super().invoke(context, event)

    def begin(self, context: bpy.types.Context, prepared: None) -> None:
        self.points: list[FloatArray] = []
        self._follow(context)

    def _follow(self, context: bpy.types.Context) -> None:
        """Take over where the mouse has been."""
        new = self.path[len(self.points) :]
        self.points.extend(targets.to_pixel(context, *place, self.size) for place in new)

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> bool | None:
        self._follow(context)
        return True if self.is_release(event) else None

    def draw_stroke(self) -> None:
        line = targets.to_region(bpy.context, np.array(self.points), self.size)
        draw_loops([line], PREVIEW, closed=self.closed and len(line) > 2)

    def outlined(self, context: bpy.types.Context, points: list[FloatArray]) -> BoolArray:
        """Mask (H,W) of an outline, snapped to the photo's edges where the user wants that."""
        loops = [np.array(points)]
        if len(points) >= 3 and context.scene.fresco_marking.snap:
            pixels = read_pixels(self.target(context))
            loops = snapped_mask_loops(pixels, loops, context.scene.fresco_marking.reach)
        return polygon_mask(loops, *self.size)


class FRESCO_OT_photo_lasso(DrawnStroke, bpy.types.Operator):
    bl_idname = "fresco.photo_lasso"
    bl_label = "Region Lasso"
    bl_description = "Draw around a region. Shift adds, Ctrl takes away"

    def apply(self, context: bpy.types.Context) -> None:
        mask = self.outlined(context, self.points)
        targets.mark_photo(context, self.target(context), mask, self.mode)


class FRESCO_OT_photo_grabcut(DrawnStroke, bpy.types.Operator):
    bl_idname = "fresco.photo_grabcut"
    bl_label = "Region GrabCut"
    bl_description = (
        "Draw roughly around a region that stands out by its colours. Shift adds, Ctrl takes away"
    )

    def apply(self, context: bpy.types.Context) -> None:
        rough = polygon_mask([np.array(self.points)], *self.size)
        photo = self.target(context)
        targets.mark_photo(context, photo, grab_cut(read_pixels(photo), rough), self.mode)


class FRESCO_OT_photo_brush(DrawnStroke, bpy.types.Operator):
    bl_idname = "fresco.photo_brush"
    bl_label = "Region Brush"
    bl_description = "Paint a region. Adds to the chosen one; Ctrl takes away"
    closed = False

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        started = super().invoke(context, event)
        self.mode = "subtract" if event.ctrl else "add"
        return started

    def draw_stroke(self) -> None:
        super().draw_stroke()
        line = targets.to_region(bpy.context, np.array(self.points), self.size)
        draw_loops([circle(line[-1], bpy.context.scene.fresco_marking.radius)], PREVIEW)

    def apply(self, context: bpy.types.Context) -> None:
        scale = targets.pixels_per_photo_pixel(context, self.size)
        stroke = brush_mask(self.points, context.scene.fresco_marking.radius / scale, *self.size)
        targets.mark_photo(context, self.target(context), stroke, self.mode)


class FRESCO_OT_photo_polygon(DrawnStroke, bpy.types.Operator):
    bl_idname = "fresco.photo_polygon"
    bl_label = "Region Polygon"
    bl_description = (
        "Click corner by corner; Enter or a click on the first corner closes, Backspace takes a corner back"
    )

    def begin(self, context: bpy.types.Context, prepared: None) -> None:
        self.points = [targets.to_pixel(context, *self.pressed, self.size)]
        self.released = False  # it was the first corner's click

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> bool | None:
        if event.value == "PRESS" and event.type in {"RET", "NUMPAD_ENTER"}:
            return True
        if event.value == "PRESS" and event.type == "BACK_SPACE":
            self.points = self.points[:-1] or self.points
        elif event.value == "PRESS" and event.type == "LEFTMOUSE":
            place = self.place(context, event)
            gap = np.linalg.norm(place - self.points[0]) * targets.pixels_per_photo_pixel(context, self.size)
            if len(self.points) >= 3 and gap < _CLOSE:
                return True
            self.points.append(place)
        return None

    def apply(self, context: bpy.types.Context) -> None:
        corners = np.array(self.points)
        marking = context.scene.fresco_marking
        if marking.snap and len(corners) >= 3:
            corners = snap_polygon(read_pixels(self.target(context)), corners, marking.reach)
        targets.mark_photo(context, self.target(context), polygon_mask([corners], *self.size), self.mode)


def _nothing_job() -> Job[None]:
    """Job of a stroke that needs no preparation."""
    yield Progress(1.0, "")
    return None


class FRESCO_OT_tidy_mark(StepOperator, bpy.types.Operator):
    bl_idname = "fresco.tidy_mark"
    bl_label = "Tidy Region"
    bl_description = "Mend the chosen region's outline in the shown photo"
    bl_options = {"REGISTER", "UNDO"}
    step = "regions"

    action: bpy.props.EnumProperty(
        name="Action",
        items=(
            ("SNAP", "Snap to Edges", "Move the outline onto the photo's edges"),
            ("FILL", "Fill Holes", "Fill what the region encloses"),
            ("SMOOTH", "Smooth", "Take teeth and steps out of the outline"),
            ("SPECKS", "Remove Specks", "Keep the largest piece only"),
        ),
    )

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        photo, region = targets.shown_photo(context), context.scene.fresco.active_region
        cls.poll_message_set("Choose a region that is marked in the shown photo")
        return photo is not None and region is not None and photo.mark(region.uid) is not None

    def run(self, context: bpy.types.Context) -> None:
        photo, region = targets.shown_photo(context), context.scene.fresco.active_region
        mask = read_mask_pixels(photo.mark(region.uid).image)
        targets.write_mask(photo, region, self.mended(context, photo, mask))

    def mended(self, context: bpy.types.Context, photo: FrescoPhoto, mask: BoolArray) -> BoolArray:
        """Mask (H,W) after the action."""
        if self.action == "FILL":
            return without_holes(mask)
        if self.action == "SPECKS":
            return without_specks(mask)
        if self.action == "SMOOTH":
            return smoothed_mask(mask, 3.0)
        reach = context.scene.fresco_marking.reach
        loops = snapped_mask_loops(read_pixels(photo), mask_polygons(smoothed_mask(mask, 1.0)), reach)
        return polygon_mask(loops, *mask.shape[::-1])


class PhotoTool(bpy.types.WorkSpaceTool):
    """Base of the Image Editor's tools."""

    bl_space_type = "IMAGE_EDITOR"
    bl_context_mode = "VIEW"


def strokes(operator: str) -> tuple[tuple[str, dict[str, object], None], ...]:
    """Left button with and without the keys that add and take away."""
    kinds = ({}, {"shift": True}, {"ctrl": True})
    return tuple((operator, {"type": "LEFTMOUSE", "value": "PRESS", **kind}, None) for kind in kinds)


class FRESCO_TOOL_photo_wand(PhotoTool):
    bl_idname = "fresco.tool_photo_wand"
    bl_label = "Region Wand"
    bl_description = "One click marks a region of the photo; drag for a smaller or larger one"
    bl_icon = "ops.paint.weight_fill"
    bl_keymap = strokes("fresco.photo_wand")
    bl_cursor = "EYEDROPPER"

    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: object) -> None:
        layout.prop(context.scene.fresco_marking, "kind")
        draw_mending(layout)


class FRESCO_TOOL_photo_polygon(PhotoTool):
    bl_idname = "fresco.tool_photo_polygon"
    bl_label = "Region Polygon"
    bl_description = "Mark a region corner by corner"
    bl_icon = "ops.mesh.polybuild_hover"
    bl_keymap = strokes("fresco.photo_polygon")
    bl_cursor = "CROSSHAIR"

    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: object) -> None:
        draw_snapping(context, layout)


class FRESCO_TOOL_photo_lasso(PhotoTool):
    bl_idname = "fresco.tool_photo_lasso"
    bl_label = "Region Lasso"
    bl_description = "Draw around a region"
    bl_icon = "ops.generic.select_lasso"
    bl_keymap = strokes("fresco.photo_lasso")
    bl_cursor = "CROSSHAIR"

    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: object) -> None:
        draw_snapping(context, layout)


class FRESCO_TOOL_photo_brush(PhotoTool):
    bl_idname = "fresco.tool_photo_brush"
    bl_label = "Region Brush"
    bl_description = "Paint a region, or take away from it with Ctrl"
    bl_icon = "ops.generic.select_circle"
    bl_keymap = strokes("fresco.photo_brush")
    bl_cursor = "PAINT_BRUSH"

    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: object) -> None:
        layout.prop(context.scene.fresco_marking, "radius")
        draw_mending(layout)


class FRESCO_TOOL_photo_grabcut(PhotoTool):
    bl_idname = "fresco.tool_photo_grabcut"
    bl_label = "Region GrabCut"
    bl_description = "Draw roughly around a region; the rest is found by its colours"
    bl_icon = "ops.mesh.knife_tool"
    bl_keymap = strokes("fresco.photo_grabcut")
    bl_cursor = "CROSSHAIR"

    def draw_settings(_context: bpy.types.Context, layout: bpy.types.UILayout, _tool: object) -> None:
        draw_mending(layout)


def draw_mending(layout: bpy.types.UILayout) -> None:
    """Buttons that mend the chosen region's outline."""
    for action, label in _MENDING.items():
        layout.operator("fresco.tidy_mark", text=label).action = action


_MENDING = {"SNAP": "Snap", "FILL": "Fill Holes", "SMOOTH": "Smooth", "SPECKS": "Remove Specks"}


def draw_snapping(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
    """Setting whether drawn outlines move onto edges."""
    marking = context.scene.fresco_marking
    layout.prop(marking, "snap")
    row = layout.row()
    row.active = marking.snap
    row.prop(marking, "reach")
    draw_mending(layout)


CLASSES = (
    FRESCO_OT_photo_wand,
    FRESCO_OT_photo_lasso,
    FRESCO_OT_photo_grabcut,
    FRESCO_OT_photo_brush,
    FRESCO_OT_photo_polygon,
    FRESCO_OT_tidy_mark,
)
TOOLS = (
    FRESCO_TOOL_photo_wand,
    FRESCO_TOOL_photo_polygon,
    FRESCO_TOOL_photo_lasso,
    FRESCO_TOOL_photo_brush,
    FRESCO_TOOL_photo_grabcut,
)
