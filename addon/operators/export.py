"""Deliver the textured scan."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import bpy

from ...core.errors import OutputError
from ...core.jobs import Job
from ...core.project.provenance import fresco_version
from ...core.project.stages.cloud import ColouredCloud
from ...core.project.stages.colour_chart import correction_for
from ...core.report import Report
from ...core.scans import Scan
from ...core.texture.colour.correction import ColourCorrection
from ..bridge.clouds import read_clouds
from ..bridge.delivery import SIMPLIFIED_KEY, read_charts, simplified_objects
from ..bridge.photos import read_photo, read_solution
from ..bridge.regions import surface_source
from ..bridge.scans import read_scan
from ..bridge.texture import layer_names, read_layers
from ..jobs import JobOperator
from ..outputs import Wanted, cloud_outputs_job, outputs_job
from .regions import has_scan


def wanted_outputs(scene: bpy.types.Scene) -> Wanted:
    """Return what the panel asks for; `OutputError` where the folder cannot be told."""
    export = scene.fresco.export
    if export.folder.startswith("//") and not bpy.data.filepath:
        raise OutputError("The export folder is beside the .blend file: save that first, or choose a folder.")
    if not export.folder.strip():
        raise OutputError("Choose a folder for the exported files.")
    folder = Path(bpy.path.abspath(export.folder))
    name = export.name.strip() or export.default_name(scene)
    layers = tuple(layer_names(scene.fresco.scan)) or ("",)
    wanted = (export.write_glb, export.write_obj, export.write_report, export.write_blend)
    models = tuple(obj.name for obj in simplified_objects(scene))
    return Wanted(folder, name, *wanted, layers, models)


def scene_report(scene: bpy.types.Scene, scan: Scan, title: str) -> Report:
    """Return the report's contents from what the scene holds."""
    items = [photo for photo in scene.fresco.photos if photo.use and photo.camera_json]
    layers = {} if scan.is_cloud else read_layers(scene)
    first = next(iter(layers), None)
    return Report(
        title=title,
        scan=scan,
        surfaces=surface_source(scene).regions(),
        photos=[read_photo(scene, item) for item in items],
        poses=[read_solution(scene, item) for item in items],
        textured=None if first is None else layers.pop(first),
        written=datetime.now(UTC).isoformat(timespec="seconds"),
        versions={"fresco": fresco_version(), "blender": bpy.app.version_string},
        layers=layers,
        made=made(scene),
    )


def made(scene: bpy.types.Scene) -> list[str]:
    """Sentences on the scene's simplified models and colour chart."""
    sentences = [f"{obj.name}: {obj[SIMPLIFIED_KEY]}." for obj in simplified_objects(scene)]
    chart = scene.fresco.delivery.chart_told
    return [*([f"Colour chart: {chart}."] if chart else []), *sentences]


def true_clouds(scene: bpy.types.Scene) -> dict[str, tuple[ColouredCloud, ColourCorrection | None]]:
    """Return the coloured points of every layer, with the correction of its colour chart."""
    charts = {} if scene.fresco.delivery.untouched else read_charts(scene)
    found = {}
    for layer, cloud in read_clouds(scene).items():
        entry, chart = charts.get(layer, (None, None))
        found[layer] = cloud, None if chart is None else correction_for(chart, entry, cloud)
    return found


class FRESCO_OT_export(JobOperator):
    bl_idname = "fresco.export"
    bl_label = "Export"
    bl_description = "Write the textured scan, its cameras and the report into the folder"
    step = "export"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not has_scan(cls, context):
            return False
        if context.mode != "OBJECT":
            cls.poll_message_set("Leave Edit Mode first")
            return False
        cls.poll_message_set("Texture the scan first (step 6)")
        return bool(context.scene.fresco.texture_report)

    def start(self, context: bpy.types.Context) -> Job[list[Path]]:
        wanted = wanted_outputs(context.scene)
        scan = read_scan(context.scene)
        report = scene_report(context.scene, scan, wanted.name)
        if scan.is_cloud:
            return cloud_outputs_job(wanted, scan, report, true_clouds(context.scene))
        return outputs_job(context, wanted, scan, report)

    def finish(self, context: bpy.types.Context, result: list[Path]) -> None:
        if not result:
            self.warn(context, "Nothing was chosen to be written.")
            return
        self.report({"INFO"}, f"{len(result)} files written to {result[0].parent}")


CLASSES = (FRESCO_OT_export,)
