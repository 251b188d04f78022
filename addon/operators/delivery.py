"""What is made of the texture for delivery: a baked atlas as a model of its own, colours of the vertices."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from ...core.jobs import Job
from ...core.project import TexturedScan
from ...core.project.delivery import BakedAtlas, DeliverySettings, bake_job, colour_job
from ...core.project.models import layer_ending
from ...core.settings import AtlasSettings
from ...core.texture.colours import Colours
from ..bridge.delivery import show_atlas
from ..bridge.maps import write_vertex_colours
from ..bridge.texture import read_texture
from ..bridge.world import read_offset
from ..jobs import JobOperator
from ..settings import to_core
from .export import wanted_outputs
from .maps import is_textured

VERTEX_COLOURS = "Fresco colour"


@dataclass(frozen=True, eq=False)
class Baked:
    """An atlas and the texture it was baked from."""

    textured: TexturedScan
    atlas: BakedAtlas


def delivery_settings(scene: bpy.types.Scene) -> DeliverySettings:
    """Return what the panel asks for."""
    delivery = scene.fresco.delivery
    return DeliverySettings(to_core(scene.fresco.atlas, AtlasSettings), delivery.level, delivery.untouched)


class FRESCO_OT_bake_atlas(JobOperator):
    bl_idname = "fresco.bake_atlas"
    bl_label = "Bake Atlas"
    bl_description = (
        "Resample the photos once into pages for delivery, beside a model that uses them; the scan keeps its "
        "texture from the originals"
    )
    bl_options = {"UNDO"}
    step = "export"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        return is_textured(cls, context)

    def start(self, context: bpy.types.Context) -> Job[Any]:
        scene = context.scene
        wanted = wanted_outputs(scene)
        name = wanted.name + layer_ending(scene.fresco.layer, "_atlas")
        textured = read_texture(scene)
        return baked_job(wanted.folder / name, name, textured, delivery_settings(scene), read_offset(scene))

    def finish(self, context: bpy.types.Context, result: Baked) -> None:
        obj = show_atlas(context, result.textured, result.atlas)
        pages = len(result.atlas.atlas.paths)
        texel, folder = 1000 * result.atlas.atlas.texel_size, result.atlas.path.parent
        self.report({"INFO"}, f"{obj.name}: {pages} pages, {texel:.2f} mm a texel, in {folder}")


def baked_job(
    folder: Path, name: str, textured: TexturedScan, settings: DeliverySettings, offset: Any
) -> Job[Baked]:
    """Bake, and keep what it was baked from."""
    atlas = yield from bake_job(folder, name, textured, settings, offset)
    return Baked(textured, atlas)


class FRESCO_OT_colour_vertices(JobOperator):
    bl_idname = "fresco.colour_vertices"
    bl_label = "Colour Vertices"
    bl_description = "Give every vertex of the scan the colour that its faces show there"
    bl_options = {"UNDO"}
    step = "export"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        return is_textured(cls, context)

    def start(self, context: bpy.types.Context) -> Job[Any]:
        return colour_job(read_texture(context.scene), delivery_settings(context.scene))

    def finish(self, context: bpy.types.Context, result: Colours) -> None:
        write_vertex_colours(context.scene.fresco.scan.data, VERTEX_COLOURS, result.rgb)
        self.report({"INFO"}, f"{int(result.seen.sum()):,} of {len(result.seen):,} vertices coloured")


CLASSES = (FRESCO_OT_bake_atlas, FRESCO_OT_colour_vertices)
