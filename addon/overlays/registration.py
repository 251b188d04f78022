"""Hooks the overlays into Blender's windows."""

from __future__ import annotations

import bpy

from ..tools.prepared import STORE
from ..tools.watch import WATCH, redraw_views
from . import cloud, maps, photo, points, residuals, scan

CLASSES = ()
_handles: list[tuple[type, object]] = []  # Blender's handles of draw callbacks


def forget() -> None:
    """Forget what belongs to one file."""
    STORE.clear()
    WATCH.clear()
    photo.OUTLINES.clear()
    scan.SHAPES.clear()
    cloud.CLOUDS.clear()
    residuals.RESIDUALS.clear()
    residuals.TIES.clear()


@bpy.app.handlers.persistent
def _file_opened(_path: str) -> None:
    forget()


@bpy.app.handlers.persistent
def _scene_changed(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Draw the regions of an edited scan anew."""
    edited = scene.fresco.scan
    if edited is not None and any(
        update.is_updated_geometry and update.id.original == edited for update in depsgraph.updates
    ):
        scan.SHAPES.clear()
        cloud.CLOUDS.changes += 1


def show_news() -> float:
    """Draw again when a thread has finished something that is to be drawn."""
    if photo.OUTLINES.news or scan.SHAPES.news or cloud.CLOUDS.news:
        redraw_views(bpy.context.window_manager)
    return _NEWS_PERIOD


_NEWS_PERIOD = 0.2  # s
_HANDLERS = (
    (bpy.app.handlers.load_post, _file_opened),
    (bpy.app.handlers.depsgraph_update_post, _scene_changed),
)


def attach() -> None:
    """Start drawing; without a window there is nothing to draw on."""
    if bpy.app.background:
        return
    image_editor, view = bpy.types.SpaceImageEditor, bpy.types.SpaceView3D
    for space, callback, stage in (
        (image_editor, photo.draw, "POST_PIXEL"),
        (view, cloud.draw, "POST_VIEW"),
        (view, scan.draw, "POST_VIEW"),
        (view, scan.draw_names, "POST_PIXEL"),
        (image_editor, residuals.draw_on_photo, "POST_PIXEL"),
        (image_editor, points.draw, "POST_PIXEL"),
        (view, residuals.draw_in_view, "POST_VIEW"),
        (view, maps.draw, "POST_PIXEL"),
    ):
        _handles.append((space, space.draw_handler_add(callback, (), "WINDOW", stage)))
    for handlers, handler in _HANDLERS:
        handlers.append(handler)
    bpy.app.timers.register(show_news, first_interval=_NEWS_PERIOD, persistent=True)


def detach() -> None:
    """Stop drawing."""
    if bpy.app.timers.is_registered(show_news):
        bpy.app.timers.unregister(show_news)
    while _handles:
        space, handle = _handles.pop()
        space.draw_handler_remove(handle, "WINDOW")
    for handlers, handler in _HANDLERS:
        if handler in handlers:
            handlers.remove(handler)
    forget()
