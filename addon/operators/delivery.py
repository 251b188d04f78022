"""What is made of the texture for delivery: a baked atlas as a model of its own, colours of the vertices."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy

from ...core.jobs import Job
from ...core.project import TexturedScan
from ...core.project.stages.colour_chart import (
    ChartResult,
    ColourChartEntry,
    correction_for,
    found_chart_job,
)
from ...core.project.stages.delivery import BakedAtlas, DeliverySettings, bake_job, colour_job
from ...core.project.stages.models import layer_ending
from ...core.project.stages.simplified import SimplifiedModel, simplified_job
from ...core.settings import TextureSettings
from ...core.texture.colour.correction import ColourCorrection
from ...core.texture.models.colours import Colours
from ..bridge import delivery as bridge
from ..bridge.images import read_mask_pixels
from ..bridge.maps import write_vertex_colours
from ..bridge.scans import read_occluders
from ..bridge.texture import read_texture
from ..bridge.world import read_offset
from ..jobs import JobOperator, StepOperator
from ..settings import to_core
from .export import wanted_outputs
from .maps import is_textured

VERTEX_COLOURS = "Fresco colour"


@dataclass(frozen=True, eq=False)
class Baked:
    """An atlas and the texture it was baked from."""

    textured: TexturedScan
    atlas: BakedAtlas


class TexturedJob(JobOperator):
    """Mixin: makes something of the texture that the scan has."""

    bl_options = {"UNDO"}
    step = "export"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        return is_textured(cls, context)


class FRESCO_OT_bake_atlas(TexturedJob):
    bl_idname = "fresco.bake_atlas"
    bl_label = "Bake Atlas"
    bl_description = (
        "Resample the photos once into pages for delivery, beside a model that uses them; the scan keeps its "
        "texture from the originals"
    )

    def start(self, context: bpy.types.Context) -> Job[Any]:
        scene = context.scene
        wanted = wanted_outputs(scene)
        name = wanted.name + layer_ending(scene.fresco.layer, "_atlas")
        textured = read_texture(scene)
        settings, correction = bridge.delivery_settings(scene), chart_correction(scene, textured)
        return baked_job(wanted.folder / name, name, textured, settings, read_offset(scene), correction)

    def finish(self, context: bpy.types.Context, result: Baked) -> None:
        obj = bridge.show_atlas(context, result.textured, result.atlas)
        pages = len(result.atlas.atlas.paths)
        texel, folder = 1000 * result.atlas.atlas.texel_size, result.atlas.path.parent
        self.report({"INFO"}, f"{obj.name}: {pages} pages, {texel:.2f} mm a texel, in {folder}")


def baked_job(
    folder: Path,
    name: str,
    textured: TexturedScan,
    settings: DeliverySettings,
    offset: Any,
    correction: ColourCorrection | None,
) -> Job[Baked]:
    """Bake, and keep what it was baked from."""
    atlas = yield from bake_job(folder, name, textured, settings, offset, None, correction)
    return Baked(textured, atlas)


class FRESCO_OT_simplify_model(TexturedJob):
    bl_idname = "fresco.simplify_model"
    bl_label = "Simplify"
    bl_description = (
        "Make a lighter model beside the scan, its texture baked anew from the photos, and tell how far it "
        "deviates; the scan stays as it is"
    )

    def start(self, context: bpy.types.Context) -> Job[Any]:
        scene = context.scene
        wanted = wanted_outputs(scene)
        name = wanted.name + layer_ending(scene.fresco.layer, "_simplified")
        textured = read_texture(scene)
        photos = scene.fresco.photos
        return simplified_job(
            wanted.folder / name,
            name,
            (textured.vertices, textured.faces),
            textured,
            bridge.simplify_settings(scene),
            replace(to_core(scene.fresco.texture, TextureSettings), gain_anchor=None),
            bridge.delivery_settings(scene),
            read_offset(scene),
            [(other.vertices, other.faces) for other in read_occluders(scene) if not other.is_cloud],
            chart_correction(scene, textured),
            [photos[view.name].priority for view in textured.views],
        )

    def finish(self, context: bpy.types.Context, result: SimplifiedModel) -> None:
        obj = bridge.show_simplified(context, result)
        self.report({"INFO"}, f"{obj.name}: {result.told}; in {result.path.parent}")


class FRESCO_OT_find_colour_chart(JobOperator):
    bl_idname = "fresco.find_colour_chart"
    bl_label = "Find Colour Chart"
    bl_description = (
        "Look for a chart of 24 patches in the chosen photo; what is baked from now on gets true "
        "colours. Where it is not found, mark its field of patches as a region in the photo and choose that"
    )
    bl_options = {"UNDO"}
    step = "export"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("Choose the photo that shows the chart")
        return context.scene.fresco.active_photo is not None

    def start(self, context: bpy.types.Context) -> Job[Any]:
        fresco = context.scene.fresco
        photo, region = fresco.active_photo, fresco.active_region
        mark = photo.mark(region.uid) if region is not None else None
        mask = read_mask_pixels(mark.image) if mark is not None and mark.image is not None else None
        return found_chart_job(ColourChartEntry(Path(photo.path), fresco.layer), mask)

    def finish(self, context: bpy.types.Context, result: tuple[ColourChartEntry, ChartResult]) -> None:
        bridge.write_chart(context.scene, *result)
        self.report({"INFO"}, f"{result[1].photo}: {result[1].told}")


class FRESCO_OT_forget_colour_chart(StepOperator):
    bl_idname = "fresco.forget_colour_chart"
    bl_label = "Forget Colour Chart"
    bl_description = "Bake the photos' own colours again"
    bl_options = {"UNDO"}
    step = "export"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("No colour chart was found yet")
        return bool(context.scene.fresco.delivery.charts_json)

    def run(self, context: bpy.types.Context) -> None:
        context.scene.fresco.delivery.charts_json = ""


def chart_correction(scene: bpy.types.Scene, textured: TexturedScan) -> ColourCorrection | None:
    """Return the colour chart's correction for a texture, None without a chart or for untouched colours."""
    charts = bridge.read_charts(scene)
    if scene.fresco.layer not in charts or scene.fresco.delivery.untouched:
        return None
    entry, chart = charts[scene.fresco.layer]
    return correction_for(chart, entry, textured)


class FRESCO_OT_colour_vertices(TexturedJob):
    bl_idname = "fresco.colour_vertices"
    bl_label = "Colour Vertices"
    bl_description = "Give every vertex of the scan the colour that its faces show there"

    def start(self, context: bpy.types.Context) -> Job[Any]:
        textured = read_texture(context.scene)
        correction = chart_correction(context.scene, textured)
        return colour_job(textured, bridge.delivery_settings(context.scene), correction)

    def finish(self, context: bpy.types.Context, result: Colours) -> None:
        write_vertex_colours(context.scene.fresco.scan.data, VERTEX_COLOURS, result.rgb)
        self.report({"INFO"}, f"{int(result.seen.sum()):,} of {len(result.seen):,} vertices coloured")


CLASSES = (
    FRESCO_OT_bake_atlas,
    FRESCO_OT_colour_vertices,
    FRESCO_OT_simplify_model,
    FRESCO_OT_find_colour_chart,
    FRESCO_OT_forget_colour_chart,
)
