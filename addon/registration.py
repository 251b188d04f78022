"""All classes of the add-on, in the order in which Blender has to know them."""

from __future__ import annotations

import bpy

from . import choices, cli, jobs, preferences, properties, settings
from .operators import (
    calibration,
    cameras,
    delivery,
    export,
    maps,
    mending,
    partners,
    photos,
    points,
    pose,
    project,
    proposals,
    refine,
    regions,
    scan,
    texture,
    transfer,
    wand_step,
)
from .overlays import registration as overlays
from .panels import base as base_panel
from .panels import export as export_panel
from .panels import maps as maps_panel
from .panels import photos as photos_panel
from .panels import points as points_panel
from .panels import pose as pose_panel
from .panels import refine as refine_panel
from .panels import regions as regions_panel
from .panels import scan as scan_panel
from .panels import texture as texture_panel
from .tools import registration as tools

_MODULES = (
    jobs,
    preferences,
    settings,
    choices,
    properties,
    scan,
    photos,
    calibration,
    cameras,
    regions,
    mending,
    wand_step,
    proposals,
    partners,
    transfer,
    pose,
    points,
    refine,
    texture,
    maps,
    project,
    export,
    delivery,
    base_panel,
    scan_panel,
    photos_panel,
    regions_panel,
    pose_panel,
    points_panel,
    refine_panel,
    texture_panel,
    maps_panel,
    export_panel,
    tools,
    overlays,
)
_commands: list[object] = []  # Blender's handles of registered commands
_CLASSES = tuple(cls for module in _MODULES for cls in module.CLASSES)


def register() -> None:
    """Register all classes, then hang the data on scene and window manager."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    properties.attach()
    jobs.attach()
    cameras.attach()
    tools.attach()
    overlays.attach()
    _commands.append(bpy.utils.register_cli_command("fresco", cli.blender_command))


def unregister() -> None:
    """Undo `register`, in reverse."""
    bpy.utils.unregister_cli_command(_commands.pop())
    overlays.detach()
    tools.detach()
    cameras.detach()
    jobs.detach()
    properties.detach()
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
