"""What all panels share: the tab, the number and state in the header, the error and the running job."""

from __future__ import annotations

import bpy

from ..jobs import state
from ..settings import draw_settings

ICON_DONE, ICON_READY, ICON_WAITING = "CHECKMARK", "RADIOBUT_ON", "RADIOBUT_OFF"


class FrescoPanel:
    """Mixin: a panel of the Fresco tab."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Fresco"


class StepPanel(FrescoPanel):
    """Mixin: the panel of one step; its header shows whether the step is done, ready or waiting."""

    step = ""

    @classmethod
    def is_done(cls, context: bpy.types.Context) -> bool:
        raise NotImplementedError

    @classmethod
    def is_ready(cls, context: bpy.types.Context) -> bool:
        raise NotImplementedError

    def draw_header(self, context: bpy.types.Context) -> None:
        waiting = ICON_READY if self.is_ready(context) else ICON_WAITING
        self.layout.label(text="", icon=ICON_DONE if self.is_done(context) else waiting)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        draw_error(layout, context, self.step)
        self.draw_step(context, layout)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        raise NotImplementedError


class SettingsPanel(FrescoPanel):
    """Mixin: the settings of a step, closed at first."""

    bl_label = "Settings"
    bl_options = {"DEFAULT_CLOSED"}
    group = ""

    def draw(self, context: bpy.types.Context) -> None:
        draw_settings(self.layout, getattr(context.scene.fresco, self.group))


def wrap(text: str, width: int) -> list[str]:
    """Break a text into lines of at most `width` characters, at spaces where there are some."""
    lines: list[str] = []
    line = ""
    for word in text.split():
        while len(word) > width:
            lines.append((line + " " + word[: width - len(line) - 1]).strip())
            word, line = word[max(1, width - len(line) - 1) :], ""
        if len(line) + 1 + len(word) > width and line:
            lines.append(line)
            line = word
        else:
            line = f"{line} {word}".strip()
    return [*lines, line] if line else lines


def draw_text(layout: bpy.types.UILayout, context: bpy.types.Context, text: str, icon: str = "NONE") -> None:
    """Draw a text over as many lines as the sidebar's width asks for; the icon stands in the first."""
    scale = context.preferences.system.ui_scale
    room = context.region.width / scale - (70 if icon != "NONE" else 45)
    column = layout.column(align=True)
    column.scale_y = 0.8
    blank = "BLANK1" if icon != "NONE" else "NONE"
    for number, line in enumerate(wrap(text, max(20, int(room / 6.2)))):
        column.label(text=line, icon=icon if number == 0 else blank)


def draw_rows(layout: bpy.types.UILayout, rows: list[tuple[str, str]]) -> None:
    """Draw names on the left and their values on the right."""
    column = layout.column(align=True)
    column.scale_y = 0.85
    for name, value in rows:
        split = column.split(factor=0.35)
        left = split.row()
        left.alignment = "RIGHT"
        left.active = False
        left.label(text=name)
        split.label(text=value)


def draw_error(layout: bpy.types.UILayout, context: bpy.types.Context, step: str) -> None:
    """Show the last error if it belongs to this step."""
    status = state(context)
    if not status.error or status.error_step != step:
        return
    box = layout.box()
    row = box.row()
    column = row.column()
    column.alert = True
    draw_text(column, context, status.error, icon="ERROR")
    row.operator("fresco.dismiss_error", text="", icon="X", emboss=False)


class FRESCO_PT_job(FrescoPanel, bpy.types.Panel):
    bl_idname = "FRESCO_PT_job"
    bl_label = "Running"
    bl_options = {"HIDE_HEADER"}
    bl_order = 0

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return state(context).running

    def draw(self, context: bpy.types.Context) -> None:
        status = state(context)
        box = self.layout.box()
        head = box.row()
        head.label(text=status.label, icon="SORTTIME")
        right = head.row()
        right.alignment = "RIGHT"
        right.label(text="stops", icon="EVENT_ESC")
        box.progress(factor=status.fraction, text=f"{100 * status.fraction:.0f} %   {status.time_left}")
        draw_text(box, context, status.message)


CLASSES = (FRESCO_PT_job,)
