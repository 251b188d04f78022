"""What a user sets once for all their work."""

from __future__ import annotations

import bpy

PACKAGE = __package__.rpartition(".")[0]  # "bl_ext.user_default.fresco", or "fresco" as a plain package

PREVIEW_SIZE = 2048


class FrescoPreferences(bpy.types.AddonPreferences):
    bl_idname = PACKAGE

    preview_size: bpy.props.IntProperty(
        name="Background size",
        default=PREVIEW_SIZE,
        min=512,
        max=16384,
        subtype="PIXEL",
        description="Longer side of the undistorted copy of a photo that a camera shows behind the scan",
    )

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "preview_size")


def preview_size(context: bpy.types.Context) -> int:
    """Longer side of a photo's background in pixels; a plain package only has the default."""
    addon = context.preferences.addons.get(PACKAGE)
    return addon.preferences.preview_size if addon is not None else PREVIEW_SIZE


CLASSES = (FrescoPreferences,)
