"""Marking regions in the photo that the Image Editor shows."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np

from ...core.arrays import BoolArray, FloatArray
from ...core.errors import RegionError
from ...core.jobs import Job, Progress
from ...core.regions.photo.grabcut import grab_cut
from ...core.regions.photo.outline import brush_mask, combined, polygon_mask
from ...core.regions.photo.snap import snap_polygon, snapped_mask_loops
from ...core.regions.photo.wand import Level, PhotoWand, WandClick
from ..background import beside_job, one_step_job
from ..bridge.images import encode_mask, read_mask_pixels
from ..bridge.regions import region_of, write_encoded_mark
from ..overlays.lines import circle, draw_loops
from ..properties import FrescoPhoto
from . import targets
from .levels import WandLevels
from .modal import BrushStroke, MarkingOperator, WandStroke
from .prepared import STORE, photo_job

PREVIEW = (1.0, 0.85, 0.2)
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

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        # The list may change while the stroke lasts, so the photo is remembered by its name.
        photo = targets.shown_photo(context)
        self.photo_name, self.size = photo.name, tuple(photo.image.size)
        self.mode = targets.stroke_mode(event)
        return super().invoke(context, event)

    def target(self, context: bpy.types.Context) -> FrescoPhoto:
        """Return the photo that the stroke began on."""
        photo = context.scene.fresco.photos.get(self.photo_name)
        if photo is None:
            raise RegionError("The photo was removed while it was marked.")
        return photo

    def apply(self, context: bpy.types.Context, result: BoolArray) -> None:
        targets.mark_photo(context, self.target(context), result, self.mode)


class FRESCO_OT_photo_wand(PhotoStroke, WandStroke, bpy.types.Operator):
    bl_idname = "fresco.photo_wand"
    bl_label = "Region Wand"
    bl_description = (
        "Click a region; drag right or left, or press plus or minus, for a larger or smaller one. Shift "
        "adds, Ctrl takes away"
    )

    def job(self, context: bpy.types.Context) -> Job[WandClick]:
        pixel = targets.to_pixel(context, *self.pressed, self.size)
        return self._click_job(self.target(context), pixel, context.scene.fresco_marking.kind)

    def _click_job(self, photo: FrescoPhoto, pixel: FloatArray, kind: str) -> Job[WandClick]:
        self.wand = wand = yield from photo_job(photo)
        return (yield from beside_job(one_step_job(lambda: wand.click(pixel, kind), "Finding the region")))

    def draw_stroke(self) -> None:
        outline = self.found.level(self.steps).outline
        draw_loops([targets.to_region(bpy.context, outline, self.size)], PREVIEW)

    def work(self, context: bpy.types.Context) -> Callable[[], BoolArray]:
        wand, level = self.wand, self.found.level(self.steps)
        return lambda: wand.mask(wand.finished(level))

    def apply(self, context: bpy.types.Context, result: BoolArray) -> None:
        photo, chosen = self.target(context), context.scene.fresco.active_region
        mark = None if chosen is None else photo.mark(chosen.uid)
        earlier = mark_pixels(mark)
        if context.scene.fresco_marking.part == "HIDDEN":
            STORE.click = None
            targets.mark_photo(context, photo, result, self.mode)
            return
        region = targets.mark_photo(context, photo, result, self.mode)
        if self.mode == "replace":
            earlier = None
        click = PhotoClick(self.wand, self.found, self.photo_name, region.uid, self.mode, earlier)
        self.keep_click(context, click)


def mark_pixels(mark: object) -> BoolArray | None:
    """Mask (H,W) of a mark, or None where there is none."""
    return None if mark is None or mark.image is None else read_mask_pixels(mark.image)


class PhotoClick(WandLevels[bytes]):
    """A click of the wand in a photo; what a level marks is kept as a mask's PNG."""

    def __init__(
        self, wand: PhotoWand, found: WandClick, photo: str, uid: int, mode: str, earlier: BoolArray | None
    ) -> None:
        super().__init__(found, uid)
        self.wand, self.photo, self.mode, self.earlier = wand, photo, mode, earlier

    def mark(self, level: Level) -> bytes:
        mask = self.wand.mask(self.wand.finished(level))
        return encode_mask(combined(self.earlier, mask, self.mode))

    def write(self, context: bpy.types.Context, mark: bytes) -> bool:
        photo, region = context.scene.fresco.photos.get(self.photo), region_of(context.scene, self.uid)
        if photo is None or region is None:
            return False
        write_encoded_mark(photo, region, mark)
        return True


class DrawnStroke(PhotoStroke):
    """Mixin: an outline or line drawn by the mouse, kept in pixels of the photo.

    `needs_photo` strokes wait until the photo is read.
    """

    closed = True
    hint = "Draw around the region   Shift: add   Ctrl: take away"

    def needs_photo(self, context: bpy.types.Context) -> bool:
        """Whether the stroke looks at the photo's pixels."""
        return bool(context.scene.fresco_marking.snap)

    def job(self, context: bpy.types.Context) -> Job[PhotoWand | None]:
        return photo_job(self.target(context)) if self.needs_photo(context) else _nothing_job()

    def begin(self, context: bpy.types.Context, prepared: PhotoWand | None) -> None:
        self.pixels = None if prepared is None else prepared.image
        self.points: list[FloatArray] = []

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> bool:
        new = self.path[len(self.points) :]
        self.points.extend(targets.to_pixel(context, *place, self.size) for place in new)
        return self.released

    def draw_stroke(self) -> None:
        if self.points:
            line = targets.to_region(bpy.context, np.array(self.points), self.size)
            draw_loops([line], PREVIEW, closed=self.closed and len(line) > 2)

    def work(self, context: bpy.types.Context) -> Callable[[], BoolArray]:
        loop, size, pixels = np.array(self.points), self.size, self.pixels
        reach = context.scene.fresco_marking.reach

        def outlined() -> BoolArray:
            snapped = pixels is not None and len(loop) >= 3
            return polygon_mask(snapped_mask_loops(pixels, [loop], reach) if snapped else [loop], *size)

        return outlined


class FRESCO_OT_photo_lasso(DrawnStroke, bpy.types.Operator):
    bl_idname = "fresco.photo_lasso"
    bl_label = "Region Lasso"
    bl_description = "Draw around a region. Shift adds, Ctrl takes away"


class FRESCO_OT_photo_grabcut(DrawnStroke, bpy.types.Operator):
    bl_idname = "fresco.photo_grabcut"
    bl_label = "Region GrabCut"
    bl_description = (
        "Draw roughly around a region that stands out by its colours. Shift adds, Ctrl takes away"
    )
    hint = "Draw roughly around the region   Shift: add   Ctrl: take away"

    def needs_photo(self, context: bpy.types.Context) -> bool:
        return True

    def work(self, context: bpy.types.Context) -> Callable[[], BoolArray]:
        rough, pixels = polygon_mask([np.array(self.points)], *self.size), self.pixels
        return lambda: grab_cut(pixels, rough)


class FRESCO_OT_photo_brush(BrushStroke, DrawnStroke, bpy.types.Operator):
    bl_idname = "fresco.photo_brush"
    bl_label = "Region Brush"
    bl_description = "Paint a region. Adds to the chosen one; Ctrl takes away"
    closed = False
    hint = "Paint the region   Ctrl: take away"

    def needs_photo(self, context: bpy.types.Context) -> bool:
        return False

    def draw_stroke(self) -> None:
        super().draw_stroke()
        if self.points:
            end = targets.to_region(bpy.context, np.array(self.points[-1:]), self.size)[0]
            draw_loops([circle(end, bpy.context.scene.fresco_marking.radius)], PREVIEW)

    def work(self, context: bpy.types.Context) -> Callable[[], BoolArray]:
        radius = context.scene.fresco_marking.radius / targets.pixels_per_photo_pixel(context, self.size)
        stroke, size = np.array(self.points), self.size
        return lambda: brush_mask(stroke, radius, *size)


class FRESCO_OT_photo_polygon(DrawnStroke, bpy.types.Operator):
    bl_idname = "fresco.photo_polygon"
    bl_label = "Region Polygon"
    bl_description = (
        "Click corner by corner; Enter or a click on the first corner closes, Backspace takes a corner back"
    )
    hint = "Click the corners   Backspace: take the last one back   first corner: close"

    def begin(self, context: bpy.types.Context, prepared: PhotoWand | None) -> None:
        super().begin(context, prepared)
        self.points = [targets.to_pixel(context, *self.pressed, self.size)]

    def is_end(self, event: bpy.types.Event) -> bool:
        return False  # every corner is a click of its own

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> bool:
        if event.value != "PRESS":
            return False
        if event.type in {"RET", "NUMPAD_ENTER"}:
            return True
        if event.type == "BACK_SPACE":
            self.points = self.points[:-1] or self.points
        elif event.type == "LEFTMOUSE":
            place = self.place(context, event)
            gap = np.linalg.norm(place - self.points[0]) * targets.pixels_per_photo_pixel(context, self.size)
            if len(self.points) >= 3 and gap < _CLOSE:
                return True
            self.points.append(place)
        return False

    def draw_stroke(self) -> None:
        """Show the sides so far, and the next one up to the mouse."""
        line = targets.to_region(bpy.context, np.array(self.points), self.size)
        mouse = np.array([self.path[-1]], dtype=np.float64)
        draw_loops([np.concatenate([line, mouse])], PREVIEW, closed=len(line) > 1)
        draw_loops([circle(line[0], _CLOSE / 2)], PREVIEW)

    def work(self, context: bpy.types.Context) -> Callable[[], BoolArray]:
        corners, size, pixels = np.array(self.points), self.size, self.pixels
        reach = context.scene.fresco_marking.reach

        def outlined() -> BoolArray:
            snapped = pixels is not None and len(corners) >= 3
            return polygon_mask([snap_polygon(pixels, corners, reach) if snapped else corners], *size)

        return outlined


def _nothing_job() -> Job[None]:
    """Job of a stroke that needs no preparation."""
    yield Progress(1.0, "")
    return None


CLASSES = (
    FRESCO_OT_photo_wand,
    FRESCO_OT_photo_lasso,
    FRESCO_OT_photo_grabcut,
    FRESCO_OT_photo_brush,
    FRESCO_OT_photo_polygon,
)
