"""Puts the tools into the toolbars."""

from __future__ import annotations

import bpy

from . import photo, scan, settings, toolbar, watch

CLASSES = (*settings.CLASSES, *watch.CLASSES, *photo.CLASSES, *scan.CLASSES)


def attach() -> None:
    """Add the tools; there are no toolbars without a window."""
    settings.attach()
    watch.attach()
    if bpy.app.background:
        return
    for tools in (toolbar.PHOTO_TOOLS, toolbar.SCAN_TOOLS):
        before = None
        for tool in tools:
            bpy.utils.register_tool(tool, after=before, separator=before is None)
            before = {tool.bl_idname}


def detach() -> None:
    """Take the tools away."""
    if not bpy.app.background:
        for tool in (*toolbar.PHOTO_TOOLS, *toolbar.SCAN_TOOLS):
            bpy.utils.unregister_tool(tool)
    watch.detach()
    settings.detach()
