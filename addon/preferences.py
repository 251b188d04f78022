"""What a user sets once for all their work."""

from __future__ import annotations

import bpy

PACKAGE = __package__.rpartition(".")[0]  # "bl_ext.user_default.fresco", or "fresco" as a plain package


class FrescoPreferences(bpy.types.AddonPreferences):
    bl_idname = PACKAGE

    preview_size: bpy.props.IntProperty(
        name="Background size",
        default=2048,
        min=512,
        max=16384,
        subtype="PIXEL",
        description="Longer side of the undistorted copy of a photo that a camera shows behind the scan",
    )

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "preview_size")


def preferences(context: bpy.types.Context) -> FrescoPreferences | None:
    """Return the add-on's preferences; none where it runs as a plain package, which keeps no preferences."""
    addon = context.preferences.addons.get(PACKAGE)
    return addon.preferences if addon is not None else None


CLASSES = (FrescoPreferences,)
