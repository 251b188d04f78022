"""Change the region of the wand's last click by keys, without holding up the window."""

from __future__ import annotations

import bpy

from ..bridge.regions import region_of
from ..jobs import StepOperator
from ..tools.modal import key_steps
from ..tools.prepared import STORE

_PERIOD = 0.01  # s between two looks at the thread


class FRESCO_OT_wand_step(StepOperator):
    bl_idname = "fresco.wand_step"
    bl_label = "Wand Tolerance"
    bl_description = "Make the region of the wand's last click larger or smaller"
    bl_options = {"REGISTER", "UNDO"}
    step = "regions"

    steps: bpy.props.IntProperty(name="Steps", default=1, description="How many regions larger or smaller")

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        click = STORE.click
        cls.poll_message_set("Click a region with the wand first")
        if click is None or region_of(context.scene, click.levels.uid) is None:
            return False
        return context.area is None or context.area.type == click.space

    def run(self, context: bpy.types.Context) -> set[str]:
        """Change it at once, as a redo does."""
        if not self._choose(context, context.scene.fresco_marking.wand_steps + self.steps):
            return {"CANCELLED"}
        return self._write(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Begin to make the level ready, and wait for it while the window goes on."""
        self.clear_error(context)
        if not self._choose(context, context.scene.fresco_marking.wand_steps + self.steps):
            return {"CANCELLED"}
        if self._click.levels.ready(self._wanted).done:
            return self.execute(context)
        self._area = context.area
        self._timer = context.window_manager.event_timer_add(_PERIOD, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if STORE.click is not self._click or (event.type == "ESC" and event.value == "PRESS"):
            return self._end(context, {"CANCELLED"})
        if more := key_steps(event):  # pressed again before the last one was ready
            self._choose(context, self._wanted + more)
        elif event.type == "TIMER" and self._click.levels.ready(self._wanted).done:
            try:
                return self._end(context, self._write(context))
            except Exception as error:
                return self._end(context, self.fail(context, error))
        return {"RUNNING_MODAL"} if more else {"PASS_THROUGH"}

    def _choose(self, context: bpy.types.Context, wanted: int) -> bool:
        """Begin to make a level ready; false, with a message, where there is none."""
        self._click = STORE.click
        if not self._click.levels.has(wanted):
            size = "larger" if wanted > context.scene.fresco_marking.wand_steps else "smaller"
            self.report({"INFO"}, f"There is no {size} region around this click")
            return False
        self._wanted = wanted
        self._click.levels.ready(wanted)
        return True

    def _write(self, context: bpy.types.Context) -> set[str]:
        """Mark the chosen level, and make the next one in this direction ready."""
        levels, marking = self._click.levels, context.scene.fresco_marking
        if not levels.write(context, levels.ready(self._wanted).result()):
            return {"CANCELLED"}
        onwards = 1 if self._wanted > marking.wand_steps else -1
        self.steps, marking.wand_steps = self._wanted - marking.wand_steps, self._wanted
        if levels.has(self._wanted + onwards):
            levels.ready(self._wanted + onwards)
        return {"FINISHED"}

    def _end(self, context: bpy.types.Context, result: set[str]) -> set[str]:
        context.window_manager.event_timer_remove(self._timer)
        if self._area is not None:
            self._area.tag_redraw()
        return result

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender ends the operator by itself."""
        self._end(context, set())


CLASSES = (FRESCO_OT_wand_step,)
