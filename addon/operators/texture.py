"""Texture the scan from the posed photos."""

from __future__ import annotations

from typing import Any

import bpy

from ...core.jobs import Job
from ...core.project.stages.cloud import colour_cloud_job
from ...core.project.stages.textures import settings_among, texture_layers_job
from ...core.settings import TextureSettings
from ..background import beside_job
from ..bridge.clouds import show_cloud, show_clouds
from ..bridge.meshes import is_cloud
from ..bridge.photos import read_view
from ..bridge.scans import read_occluders, read_scan
from ..bridge.texture import layer_names, show_layer, show_layers
from ..jobs import JobOperator, StepOperator
from ..settings import to_core
from .regions import has_faces, has_scan


class FRESCO_OT_texture_scan(JobOperator):
    bl_idname = "fresco.texture_scan"
    bl_label = "Texture Scan"
    bl_description = (
        "Choose the best photo for every face and lay it on, straight from the original pixels; of a cloud, "
        "colour the points"
    )
    bl_options = {"UNDO"}
    step = "texture"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not has_scan(cls, context):
            return False
        if context.mode != "OBJECT":
            cls.poll_message_set("Leave Edit Mode first")
            return False
        cls.poll_message_set("No photo that is in use has a pose yet: solve the poses first (step 4)")
        return bool(posed_photos(context.scene))

    def start(self, context: bpy.types.Context) -> Job[Any]:
        scene = context.scene
        photos = posed_photos(scene)
        scan = read_scan(scene)
        views = [read_view(scene, photo) for photo in photos]
        layers, priorities = [p.layer.strip() for p in photos], [p.priority for p in photos]
        names = [photo.name for photo in scene.fresco.photos]
        numbers = [names.index(photo.name) for photo in photos]
        settings = settings_among(to_core(scene.fresco.texture, TextureSettings), numbers)
        if scan.is_cloud:
            return beside_job(colour_cloud_job(scan, views, layers, settings))
        occluders = read_occluders(scene)
        return texture_layers_job(scan, views, layers, settings, occluders, priorities=priorities)

    def finish(self, context: bpy.types.Context, result: Any) -> None:
        if is_cloud(context.scene.fresco.scan.data):
            show_clouds(context.scene, result)
            return
        show_layers(context.scene, result)
        show_photos(context)


def posed_photos(scene: bpy.types.Scene) -> list[Any]:
    """Photos that are in use and have a pose."""
    return [photo for photo in scene.fresco.photos if photo.is_posed and photo.use and photo.use_texture]


def show_photos(context: bpy.types.Context, equalised: bool = False) -> None:
    """Show the texture in the 3D view: the original pixels, or with each photo's gain."""
    space = context.space_data
    if space is None or space.type != "VIEW_3D":
        return
    if equalised:
        context.scene.view_settings.view_transform = "Standard"  # a photo is no scene to be toned
        space.shading.type = "MATERIAL"
        return
    space.shading.type = "SOLID"
    space.shading.light = "FLAT"
    space.shading.color_type = "TEXTURE"


class FRESCO_OT_show_texture(StepOperator):
    bl_idname = "fresco.show_texture"
    bl_label = "Show Texture"
    bl_description = "Show the texture in this 3D view"
    step = "texture"

    equalised: bpy.props.BoolProperty(
        name="Equalised",
        description="With each photo's gain, instead of the untouched pixels",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def description(cls, context: bpy.types.Context, properties: Any) -> str:
        if properties.equalised:
            return "Show the texture with one gain per photo, which makes the photos agree"
        return "Show the untouched pixels of the photos"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not has_faces(cls, context):
            return False
        cls.poll_message_set("Texture the scan first (step 6)")
        return bool(context.scene.fresco.texture_report)

    def run(self, context: bpy.types.Context) -> None:
        show_photos(context, self.equalised)


class FRESCO_OT_next_layer(StepOperator):
    bl_idname = "fresco.next_layer"
    bl_label = "Next Layer"
    bl_description = "Show the texture of the next set of photos: visible light, raking light, infrared"
    bl_options = {"UNDO"}
    step = "texture"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("The texture has one layer; name another one for some photos and texture again")
        return context.mode == "OBJECT" and len(layer_names(context.scene.fresco.scan)) > 1

    def run(self, context: bpy.types.Context) -> None:
        names = layer_names(context.scene.fresco.scan)
        place = names.index(context.scene.fresco.layer) if context.scene.fresco.layer in names else -1
        chosen = names[(place + 1) % len(names)]
        if is_cloud(context.scene.fresco.scan.data):
            show_cloud(context.scene, chosen)
            return
        show_layer(context.scene, chosen)
        show_photos(context)


CLASSES = (FRESCO_OT_texture_scan, FRESCO_OT_show_texture, FRESCO_OT_next_layer)
