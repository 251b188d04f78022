"""What the marking operators share: a job first, then the mouse, a preview, and one undo step at the end."""

from __future__ import annotations

import time
from typing import Any

import bpy

from ...core.jobs import Job
from ..jobs import SLICE, StepOperator

NAVIGATION = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "WHEELINMOUSE", "WHEELOUTMOUSE"}


class MarkingOperator(StepOperator):
    """Mixin: a stroke with the mouse that may have to wait for a photo or scan to be prepared.

    `job` prepares, `begin` is called with its result, then `handle` with every event until it returns True
    (done)
    or False (given up); `path` are the mouse's places in the region since the button went down, also while
    preparing; `draw_stroke` shows the stroke.
    """

    bl_options = {"REGISTER", "UNDO"}
    step = "regions"
    space: type = bpy.types.SpaceImageEditor

    def job(self, context: bpy.types.Context) -> Job[Any]:
        raise NotImplementedError

    def begin(self, context: bpy.types.Context, prepared: Any) -> None:
        raise NotImplementedError

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> bool | None:
        raise NotImplementedError

    def draw_stroke(self) -> None:
        raise NotImplementedError

    def apply(self, context: bpy.types.Context) -> None:
        """Write the stroke to the scene."""
        raise NotImplementedError

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.clear_error(context)
        self._handle = self._timer = None
        self._area, self._region = context.area, context.region
        self.pressed, self.released = (event.mouse_region_x, event.mouse_region_y), False
        self.path = [self.pressed]
        self.ready_for_mouse = False
        try:
            self._job = self.job(context)
        except Exception as error:
            return self.fail(context, error)
        manager = context.window_manager
        self._timer = manager.event_timer_add(0.01, window=context.window)
        self._handle = self.space.draw_handler_add(self._draw, (), "WINDOW", "POST_PIXEL")
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type in {"ESC", "RIGHTMOUSE"} and event.value == "PRESS":
            self._end(context)
            return {"CANCELLED"}
        try:
            done = self._step(context, event)
        except Exception as error:
            self._end(context)
            return self.fail(context, error)
        if done is None:
            return {"PASS_THROUGH"} if event.type in NAVIGATION else {"RUNNING_MODAL"}
        self._end(context)
        return {"FINISHED"} if done else {"CANCELLED"}

    def _step(self, context: bpy.types.Context, event: bpy.types.Event) -> bool | None:
        if event.type in {"MOUSEMOVE", "INBETWEEN_MOUSEMOVE"} and not self.released:
            self.path.append((event.mouse_region_x, event.mouse_region_y))
        if not self.ready_for_mouse:
            if event.type == "LEFTMOUSE" and event.value == "RELEASE":
                self.released = True
            if event.type != "TIMER" or not self._prepare(context):
                return None
            self.begin(context, self._prepared)
            self._area.tag_redraw()
            if not self.released:
                return None
        done = self.handle(context, event)
        self._area.tag_redraw()
        if done:
            self.apply(context)
        return done

    def _prepare(self, context: bpy.types.Context) -> bool:
        """Advance the job by a slice; true when it has ended."""
        until = time.perf_counter() + SLICE
        try:
            while True:
                progress = next(self._job)
                context.workspace.status_text_set(
                    f"{self.bl_label}: {progress.message}   {100 * progress.fraction:.0f} %      ESC stops"
                )
                if time.perf_counter() > until:
                    return False
        except StopIteration as stop:
            self._prepared = stop.value
        context.workspace.status_text_set(self.bl_description)
        self.ready_for_mouse = True
        return True

    def is_release(self, event: bpy.types.Event) -> bool:
        """Whether the stroke's button is up, now or since before the preparation ended."""
        return self.released or (event.type == "LEFTMOUSE" and event.value == "RELEASE")

    def _draw(self) -> None:
        if self.ready_for_mouse and bpy.context.area == self._area:
            self.draw_stroke()

    def _end(self, context: bpy.types.Context) -> None:
        """Take every trace of the stroke from the window."""
        self._job.close()
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
        if self._handle is not None:
            self.space.draw_handler_remove(self._handle, "WINDOW")
        self._timer = self._handle = None
        context.workspace.status_text_set(None)
        self._area.tag_redraw()

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender ends the operator by itself."""
        self._end(context)
