"""Fresco in Blender: operators, panels and what the .blend keeps. Computation is in `core`."""

from __future__ import annotations

import bpy

from . import jobs, preferences, properties, settings
from .operators import scan as scan_operators
from .panels import base as panel_base
from .panels import scan as scan_panel

_MODULES = (jobs, preferences, settings, properties, scan_operators, panel_base, scan_panel)
_CLASSES = tuple(cls for module in _MODULES for cls in module.CLASSES)


def register() -> None:
    """Register all classes, then hang the data on scene and window manager."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    properties.attach()
    jobs.attach()


def unregister() -> None:
    """Undo `register`, in reverse."""
    jobs.detach()
    properties.detach()
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
