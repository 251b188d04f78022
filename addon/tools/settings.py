"""What the marking tools are set to, in the scene."""

from __future__ import annotations

import bpy


class FrescoMarking(bpy.types.PropertyGroup):
    """Settings of the marking tools."""

    kind: bpy.props.EnumProperty(
        name="Look for",
        items=(
            ("auto", "Best", "A straight frame or an area of one colour, whatever the photo supports better"),
            ("frame", "Frames", "Straight-sided frames of three or four sides: panels, windows, doors"),
            ("colour", "Colour", "A closed area of like colour: openings, painted fields"),
        ),
        description="What the wand looks for around a click",
    )
    radius: bpy.props.IntProperty(
        name="Radius", default=30, min=1, max=2000, subtype="PIXEL", description="Brush radius on the screen"
    )
    snap: bpy.props.BoolProperty(
        name="Snap to Edges", default=False, description="Move a drawn outline onto the photo's edges nearby"
    )
    reach: bpy.props.IntProperty(
        name="Reach", default=8, min=1, max=100, subtype="PIXEL", description="How far an outline may move"
    )


CLASSES = (FrescoMarking,)


def attach() -> None:
    """Hang the settings on the scene."""
    bpy.types.Scene.fresco_marking = bpy.props.PointerProperty(type=FrescoMarking)


def detach() -> None:
    """Remove their definition."""
    del bpy.types.Scene.fresco_marking
