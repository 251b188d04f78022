"""Watches what the user works on: makes shown photos and scans ready, and keeps the advice fresh."""

from __future__ import annotations

import json

import bpy

from ...core.errors import FrescoError
from ..background import Preparation, Signature
from ..bridge.meshes import is_cloud
from ..jobs import redraw_panels
from . import advice, targets
from .prepared import STORE, prepare_photo, prepare_scan

_PERIOD = 0.4  # s between two looks; a change is acted on when it has lasted this long


class FrescoAdvice(bpy.types.PropertyGroup):
    """Advice on the regions marked in the chosen photo, as the panel shows it; not saved."""

    photo: bpy.props.StringProperty(options={"SKIP_SAVE"})
    pose: bpy.props.StringProperty(options={"SKIP_SAVE"})
    regions_json: bpy.props.StringProperty(options={"SKIP_SAVE"})
    working: bpy.props.BoolProperty(options={"SKIP_SAVE"})


class Watch:
    """What was seen at the last look, and the advice that is being worked out."""

    def __init__(self) -> None:
        self.seen: Signature = ()
        self.proposed: Signature = ()
        self.told: Signature = ()
        self.work: Preparation[advice.Advice] | None = None

    def clear(self) -> None:
        """Forget all: another file was opened, or the add-on goes."""
        if self.work is not None:
            self.work.stop()
        self.seen, self.told, self.proposed, self.work = (), (), (), None


WATCH = Watch()
"""Belongs to the window, not to the file: threads cannot be saved."""


def tick() -> float:
    """Look around; Blender calls this again after the time that it returns."""
    manager = bpy.context.window_manager
    windows = manager.windows if manager is not None else ()
    if not windows or manager.fresco_job.running:
        return _PERIOD
    scene = windows[0].scene
    for window in windows:
        _make_ready(window)
    _advise(scene)
    return _PERIOD


def _make_ready(window: bpy.types.Window) -> None:
    """Begin to prepare what a marking tool in the window's toolbars is about to be used on."""
    tools = window.workspace.tools
    photo_tool, scan_tool = (
        tools.from_space_image_mode("VIEW", create=False),
        tools.from_space_view3d_mode("OBJECT", create=False),
    )
    scan = window.scene.fresco.scan
    for area in window.screen.areas:
        if area.type == "IMAGE_EDITOR" and _is_ours(photo_tool):
            photo = targets.photo_of(window.scene, area.spaces.active.image)
            if photo is not None and (STORE.photo is None or STORE.photo.signature != (photo.path,)):
                prepare_photo(photo)
        elif area.type == "VIEW_3D" and STORE.scan is None and _is_needed(scan, scan_tool):
            prepare_scan(scan)


def _is_needed(scan: bpy.types.Object | None, tool: bpy.types.WorkSpaceTool | None) -> bool:
    """Whether a scan is about to be clicked, or drawn by what its preparation finds: a cloud is shaded."""
    return scan is not None and scan.mode == "OBJECT" and (_is_ours(tool) or is_cloud(scan.data))


def _is_ours(tool: bpy.types.WorkSpaceTool | None) -> bool:
    return tool is not None and tool.idname.startswith("fresco.")


def _advise(scene: bpy.types.Scene) -> None:
    """Begin new advice when something has changed and then stayed as it is, and show what is ready."""
    scan = scene.fresco.scan
    if scan is not None and scan.mode == "EDIT":
        return  # while a mesh is edited its attributes cannot be read
    manager = bpy.context.window_manager
    signature = advice.advice_signature(scene)
    settled, WATCH.seen = signature == WATCH.seen, signature
    marking = scene.fresco_marking
    proposed = len(marking.proposals), marking.proposal_index
    if not settled or proposed != WATCH.proposed:
        WATCH.proposed = proposed
        redraw_views(manager)
    if WATCH.work is not None and WATCH.work.signature != signature:
        WATCH.work.stop()
        WATCH.work = None
    if WATCH.work is None and settled and signature != WATCH.told:
        WATCH.told = signature
        WATCH.work = Preparation(signature, advice.advice_job(scene)) if signature else None
        _show(manager, None)
    elif WATCH.work is not None and WATCH.work.done:
        work, WATCH.work = WATCH.work, None
        manager.fresco_advice.photo = scene.fresco.active_photo.name
        _show(manager, _outcome(work))


def _outcome(work: Preparation[advice.Advice]) -> advice.Advice:
    """Advice, or the sentence that says why there is none."""
    try:
        return work.result()
    except FrescoError as error:
        return advice.Advice({}, str(error))


def _show(manager: bpy.types.WindowManager, told: advice.Advice | None) -> None:
    """Put advice into the panel; None while it is worked out."""
    shown = manager.fresco_advice
    shown.working = told is None and WATCH.work is not None
    if told is not None or WATCH.work is None:
        shown.pose = "" if told is None else told.pose
        qualities = {} if told is None else {name: vars(q) for name, q in told.qualities.items()}
        shown.regions_json = json.dumps(qualities)
    redraw_panels(bpy.context)


def redraw_views(manager: bpy.types.WindowManager) -> None:
    """Draw photos and scan again: buttons of a sidebar change what lies over them."""
    for window in manager.windows:
        for area in window.screen.areas:
            if area.type in {"VIEW_3D", "IMAGE_EDITOR"}:
                area.tag_redraw()


CLASSES = (FrescoAdvice,)


def attach() -> None:
    """Begin to watch; without a window there is nothing to see."""
    bpy.types.WindowManager.fresco_advice = bpy.props.PointerProperty(type=FrescoAdvice)
    if not bpy.app.background:
        bpy.app.timers.register(tick, first_interval=1.0, persistent=True)


def detach() -> None:
    """Stop watching."""
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    WATCH.clear()
    del bpy.types.WindowManager.fresco_advice
