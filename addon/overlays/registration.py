"""Hooks the overlays into Blender's windows."""

from __future__ import annotations

import bpy

from ..tools.prepared import STORE
from . import photo, residuals, scan

CLASSES = ()
_handles: list[tuple[type, object]] = []  # Blender's handles of draw callbacks


@bpy.app.handlers.persistent
def _file_opened(_path: str) -> None:
    """Forget what belongs to the file before."""
    STORE.clear()
    photo.OUTLINES.clear()
    scan.BATCHES.clear()
    residuals.RESIDUALS.clear()


def attach() -> None:
    """Start drawing; without a window there is nothing to draw on."""
    if bpy.app.background:
        return
    image_editor, view = bpy.types.SpaceImageEditor, bpy.types.SpaceView3D
    _handles.append((image_editor, image_editor.draw_handler_add(photo.draw, (), "WINDOW", "POST_PIXEL")))
    _handles.append((view, view.draw_handler_add(scan.draw, (), "WINDOW", "POST_VIEW")))
    over_photo = image_editor.draw_handler_add(residuals.draw_on_photo, (), "WINDOW", "POST_PIXEL")
    over_view = view.draw_handler_add(residuals.draw_in_view, (), "WINDOW", "POST_VIEW")
    _handles.extend([(image_editor, over_photo), (view, over_view)])
    bpy.app.handlers.load_post.append(_file_opened)


def detach() -> None:
    """Stop drawing."""
    while _handles:
        space, handle = _handles.pop()
        space.draw_handler_remove(handle, "WINDOW")
    if _file_opened in bpy.app.handlers.load_post:
        bpy.app.handlers.load_post.remove(_file_opened)
    STORE.clear()
