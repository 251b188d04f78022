"""Runs a core job as a modal operator with progress and ESC, or to its end where there is no window.

An operator that is a job derives from `JobOperator` and defines `start(context) -> job`, which copies
Blender's data to numpy, and `finish(context, result)`, the only writer to Blender. Closing the job leaves the
scene as it was.
"""

from __future__ import annotations

import time
from typing import Any

import bpy

from ..core.errors import FrescoError
from ..core.jobs import Job, Progress, drain

SLICE = 0.03  # s of work per timer event: the window stays fluid
TIMER_STEP = 0.01  # s
NAVIGATION = {
    "MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "WHEELINMOUSE", "WHEELOUTMOUSE", "MOUSEMOVE",
    "INBETWEEN_MOUSEMOVE", "TRACKPADPAN", "TRACKPADZOOM", "NDOF_MOTION", "WINDOW_DEACTIVATE",
}  # fmt: skip


class FrescoJobState(bpy.types.PropertyGroup):
    """The running job and the last error, as the panel shows them; in the window manager, not saved."""

    running: bpy.props.BoolProperty(options={"SKIP_SAVE"})
    label: bpy.props.StringProperty(options={"SKIP_SAVE"})
    fraction: bpy.props.FloatProperty(min=0, max=1, options={"SKIP_SAVE"})
    message: bpy.props.StringProperty(options={"SKIP_SAVE"})
    time_left: bpy.props.StringProperty(options={"SKIP_SAVE"})
    error: bpy.props.StringProperty(options={"SKIP_SAVE"})
    error_step: bpy.props.StringProperty(options={"SKIP_SAVE"})


def state(context: bpy.types.Context) -> FrescoJobState:
    """Return the window manager's job state."""
    return context.window_manager.fresco_job


def error_sentence(error: Exception) -> str | None:
    """Return what to tell the user of an error they can mend, or None for a defect of the program."""
    if isinstance(error, FrescoError):
        return str(error)
    if isinstance(error, MemoryError):
        return "There is not enough memory for this step: close other programs, or use a coarser scan."
    if isinstance(error, OSError):
        name = f"{error.filename}: " if error.filename else ""
        return f"{name}{error.strerror or error}"
    return None


def format_seconds(seconds: float) -> str:
    """Return a duration as a person says it: 8 s, 2 min 10 s, 1 h 05 min."""
    whole = max(1, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def time_left(elapsed: float, fraction: float) -> str:
    """Return the time still needed after `elapsed` seconds, or nothing while it cannot be told."""
    if elapsed < 1.0 or fraction < 0.02 or fraction >= 1.0:
        return ""
    return format_seconds(elapsed * (1 - fraction) / fraction) + " left"


class StepOperator(bpy.types.Operator):
    """An operator whose mendable errors become a sentence in the status bar and in its step's panel."""

    step = ""  # the panel that shows its errors

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if state(context).running:
            cls.poll_message_set("Another step is running: wait for it, or press ESC to stop it")
            return False
        return cls.ready(context)

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        """Whether the step can start; says with `poll_message_set` what is missing."""
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        self.clear_error(context)
        try:
            return self.run(context) or {"FINISHED"}
        except Exception as error:
            return self.fail(context, error)

    def run(self, context: bpy.types.Context) -> set[str] | None:
        """Do the step."""
        raise NotImplementedError

    def clear_error(self, context: bpy.types.Context) -> None:
        state(context).error = ""

    def warn(self, context: bpy.types.Context, sentence: str) -> None:
        """Tell the user of something that did not stop the step."""
        state(context).error = sentence
        state(context).error_step = self.step
        self.report({"WARNING"}, sentence)

    def fail(self, context: bpy.types.Context, error: Exception) -> set[str]:
        """Tell the user; a defect of the program is raised on."""
        sentence = error_sentence(error)
        if sentence is None:
            raise error
        state(context).error = sentence
        state(context).error_step = self.step
        self.report({"ERROR"}, sentence)
        return {"CANCELLED"}


class JobOperator(StepOperator):
    """A step that takes its time: modal with progress in a window, to the end without one."""

    _interactive = False
    _job: Job[Any] | None = None
    _timer: bpy.types.Timer | None = None
    _began = 0.0

    def start(self, context: bpy.types.Context) -> Job[Any]:
        """Copy what the job needs out of Blender and return the job."""
        raise NotImplementedError

    def finish(self, context: bpy.types.Context, result: Any) -> None:
        """Write the job's result to Blender."""
        raise NotImplementedError

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self._interactive = True
        return self.execute(context)

    def choose_file(self, context: bpy.types.Context) -> set[str]:
        """Open the file browser, which then runs the step."""
        self._interactive = True
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def run(self, context: bpy.types.Context) -> set[str] | None:
        job = self.start(context)
        if self._interactive and not bpy.app.background and context.window is not None:
            return self._begin(context, job)
        try:
            result = drain(job)
        finally:
            job.close()
        self.finish(context, result)
        return {"FINISHED"}

    def _begin(self, context: bpy.types.Context, job: Job[Any]) -> set[str]:
        self._job = job
        self._began = time.perf_counter()
        status = state(context)
        status.running, status.label = True, self.bl_label
        status.fraction, status.message, status.time_left = 0.0, "", ""
        manager = context.window_manager
        manager.progress_begin(0, 100)
        self._timer = manager.event_timer_add(TIMER_STEP, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC" and event.value == "PRESS":
            self._end(context)
            self.report({"INFO"}, f"{self.bl_label} stopped; nothing was changed")
            return {"CANCELLED"}
        if event.type == "TIMER":
            return self._advance(context)
        # The view may be turned meanwhile; anything that edits the scene has to wait.
        return {"PASS_THROUGH"} if event.type in NAVIGATION else {"RUNNING_MODAL"}

    def _advance(self, context: bpy.types.Context) -> set[str]:
        until = time.perf_counter() + SLICE
        try:
            progress = next(self._job)
            while time.perf_counter() < until:
                progress = next(self._job)
            self._show(context, progress)
            return {"RUNNING_MODAL"}
        except StopIteration as stop:
            self._end(context)
            return self._complete(context, stop.value)
        except Exception as error:
            self._end(context)
            return self.fail(context, error)

    def _complete(self, context: bpy.types.Context, result: Any) -> set[str]:
        try:
            self.finish(context, result)
        except Exception as error:
            return self.fail(context, error)
        return {"FINISHED"}

    def _show(self, context: bpy.types.Context, progress: Progress) -> None:
        status = state(context)
        status.fraction, status.message = progress.fraction, progress.message
        status.time_left = time_left(time.perf_counter() - self._began, progress.fraction)
        context.window_manager.progress_update(100 * progress.fraction)
        parts = [f"{self.bl_label}: {progress.message}", f"{100 * progress.fraction:.0f} %", status.time_left]
        context.workspace.status_text_set("   ".join(part for part in parts if part) + "      ESC stops")
        redraw_panels(context)

    def _end(self, context: bpy.types.Context) -> None:
        """Close the job and take every trace of it from the window."""
        job, self._job = self._job, None
        timer, self._timer = self._timer, None
        if job is not None:
            job.close()
        if timer is not None:
            context.window_manager.event_timer_remove(timer)
            context.window_manager.progress_end()
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        state(context).running = False
        redraw_panels(context)

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender ends the operator by itself: another file is opened, or the program quits."""
        self._end(context)


def redraw_panels(context: bpy.types.Context) -> None:
    """Draw the sidebars of all 3D views and Image Editors again."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in {"VIEW_3D", "IMAGE_EDITOR"}:
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()


class FRESCO_OT_dismiss_error(bpy.types.Operator):
    bl_idname = "fresco.dismiss_error"
    bl_label = "Dismiss"
    bl_description = "Take this message away"

    def execute(self, context: bpy.types.Context) -> set[str]:
        state(context).error = ""
        return {"FINISHED"}


CLASSES = (FrescoJobState, FRESCO_OT_dismiss_error)


def attach() -> None:
    """Hang the job state on the window manager."""
    bpy.types.WindowManager.fresco_job = bpy.props.PointerProperty(type=FrescoJobState)


def detach() -> None:
    """Remove the job state."""
    del bpy.types.WindowManager.fresco_job
