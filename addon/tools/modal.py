"""What the marking operators share: prepare, follow the mouse with a preview, compute, and one undo step."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import bpy

from ...core.jobs import Job
from ..background import beside_job, one_step_job
from ..jobs import SLICE, StepOperator
from .levels import WandLevels
from .prepared import STORE, LastClick

NAVIGATION = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "WHEELINMOUSE", "WHEELOUTMOUSE"}
CONFIRM = {"RET", "NUMPAD_ENTER"}
LARGER = {"NUMPAD_PLUS", "PLUS", "EQUAL"}
SMALLER = {"NUMPAD_MINUS", "MINUS"}
KEYS = "Enter: accept   Esc, right click: cancel"


def key_steps(event: bpy.types.Event) -> int:
    """Steps of the wand's tolerance that a key asks for: plus and minus."""
    if event.value != "PRESS":
        return 0
    return (event.type in LARGER) - (event.type in SMALLER)


class MarkingOperator(StepOperator):
    """Mixin: a stroke with the mouse. Waiting and computing happen beside the window, which stays fluid.

    `job` prepares and `begin` gets its result; `handle` is called with every event until it returns True:
    the stroke is drawn. `path` are the mouse's places in the region since the button went down, also while
    preparing; `draw_stroke` shows the stroke. `work` gives a function that computes what the stroke marks,
    and `apply` writes that to the scene.
    """

    bl_options = {"REGISTER", "UNDO"}
    step = "regions"
    space: type = bpy.types.SpaceImageEditor
    hint = ""

    def job(self, context: bpy.types.Context) -> Job[Any]:
        """Prepare what the stroke needs."""
        raise NotImplementedError

    def begin(self, context: bpy.types.Context, prepared: Any) -> None:
        """Take over what was prepared."""
        raise NotImplementedError

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> bool:
        """Follow the mouse; true when the stroke is drawn."""
        raise NotImplementedError

    def draw_stroke(self) -> None:
        """Show the stroke so far."""
        raise NotImplementedError

    def work(self, context: bpy.types.Context) -> Callable[[], Any]:
        """Return what is left to compute, as a function that touches no Blender data."""
        raise NotImplementedError

    def apply(self, context: bpy.types.Context, result: Any) -> None:
        """Write what was computed to the scene."""
        raise NotImplementedError

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.clear_error(context)
        self._handle = self._timer = None
        self._area, self._region = context.area, context.region
        self.pressed, self.released = (event.mouse_region_x, event.mouse_region_y), False
        self.path = [self.pressed]
        self._begun, self._finishing = False, False
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
        if done:
            self._end(context)
            return {"FINISHED"}
        return {"PASS_THROUGH"} if event.type in NAVIGATION else {"RUNNING_MODAL"}

    def _step(self, context: bpy.types.Context, event: bpy.types.Event) -> bool:
        """Handle an event; true when all is written."""
        self._follow_mouse(event)
        if self._finishing or not self._begun:
            if event.type != "TIMER" or not self._advance(context):
                return False
            if self._finishing:
                self.apply(context, self._result)
                return True
            self._begun = True
            self.begin(context, self._result)
            context.workspace.status_text_set(f"{self.hint}   {KEYS}")
        if self.handle(context, event):
            self._finishing = True
            self._job = beside_job(one_step_job(self.work(context), "Finishing the outline"))
        self._area.tag_redraw()
        return False

    def _follow_mouse(self, event: bpy.types.Event) -> None:
        if event.type in {"MOUSEMOVE", "INBETWEEN_MOUSEMOVE"} and not self.released:
            self.path.append((event.mouse_region_x, event.mouse_region_y))
        elif self.is_end(event):
            self.released = True

    def is_end(self, event: bpy.types.Event) -> bool:
        """Whether an event ends a stroke: the button goes up, or Enter."""
        if event.type == "LEFTMOUSE":
            return event.value == "RELEASE"
        return event.type in CONFIRM and event.value == "PRESS"

    def _advance(self, context: bpy.types.Context) -> bool:
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
            self._result = stop.value
        return True

    def _draw(self) -> None:
        if self._begun and bpy.context.area == self._area:
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


class WandStroke(MarkingOperator):
    """Mixin: a click that finds regions of several sizes, of which dragging and keys choose one.

    `found` is what the click has found, `steps` how many sizes the chosen one is from the best.
    """

    step_width = 14
    """Screen pixels of dragging per size."""
    hint = "Drag right, left or plus, minus: larger, smaller   Shift: add   Ctrl: take away"

    def begin(self, context: bpy.types.Context, prepared: Any) -> None:
        self.found = prepared
        self.steps = self.by_key = 0

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> bool:
        self.by_key += key_steps(event)
        self.steps = round((self.path[-1][0] - self.pressed[0]) / self.step_width) + self.by_key
        return self.released

    def keep_click(self, context: bpy.types.Context, click: WandLevels[Any]) -> None:
        """Let keys change the click later."""
        STORE.click = LastClick(click, self._area.type)
        context.scene.fresco_marking.wand_steps = self.steps


class BrushStroke(MarkingOperator):
    """Mixin: a stroke that adds to the chosen region, and takes away with Ctrl; it never begins anew."""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        started = super().invoke(context, event)
        self.mode = "subtract" if event.ctrl else "add"
        return started
