"""Puts the tools into the toolbars."""

from __future__ import annotations

import bpy

from . import photo, scan, settings

CLASSES = (*settings.CLASSES, *photo.CLASSES, *scan.CLASSES)


def attach() -> None:
    """Add the tools; there are no toolbars without a window."""
    settings.attach()
    if bpy.app.background:
        return
    for tools in (photo.TOOLS, scan.TOOLS):
        before = None
        for tool in tools:
            bpy.utils.register_tool(tool, after=before, separator=before is None)
            before = {tool.bl_idname}


def detach() -> None:
    """Take the tools away."""
    if not bpy.app.background:
        for tool in (*photo.TOOLS, *scan.TOOLS):
            bpy.utils.unregister_tool(tool)
    settings.detach()
