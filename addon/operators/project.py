"""Open and save a project file in the window: the same file that runs without one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import bpy

from ...core.arrays import FloatArray, IntArray
from ...core.errors import ScanError
from ...core.jobs import Job, part
from ...core.pose.points.survey import Survey
from ...core.project import Project, load_project
from ...core.project.file.save import Unsaved, save_project_job
from ...core.project.run import charts_job, check_inputs_job, read_scans_job
from ...core.project.stages.surfaces import check_partners, region_faces
from ..background import beside_job, one_step_job
from ..bridge.points import read_points
from ..bridge.projects import OpenedProject, previews_job, read_project, show_project
from ..bridge.regions import KeptScan, keep_scan
from ..bridge.scans import read_occluders
from ..bridge.world import read_offset
from ..jobs import JobOperator
from ..preferences import preview_size
from .regions import has_scan

Triangles = tuple[FloatArray, IntArray]


def open_project_job(project: Project, size: int) -> Job[OpenedProject]:
    """Read everything a project needs in the window; `size` is that of the photos' backgrounds."""
    yield from part(check_inputs_job(project), 0.0, 0.3)
    scan, occluders = yield from part(read_scans_job(project), 0.3, 0.6)
    faces = region_faces(project, scan)
    check_partners(project, [*faces, *project.regions.outlines])
    charts = yield from part(charts_job(project), 0.6, 0.7)
    previews = yield from part(previews_job(project, size), 0.7, 1.0)
    return OpenedProject(project, scan, faces, previews, occluders, charts)


class FRESCO_OT_open_project(JobOperator):
    bl_idname = "fresco.open_project"
    bl_label = "Open Project"
    bl_description = (
        "Read scan, photos, regions and settings from a project file; replaces those of this scene"
    )
    bl_options = {"UNDO"}
    step = "scan"

    filepath: bpy.props.StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("Leave Edit Mode first")
        return context.mode == "OBJECT"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return super().invoke(context, event) if self.filepath else self.choose_file(context)

    def start(self, context: bpy.types.Context) -> Job[OpenedProject]:
        project = load_project(Path(bpy.path.abspath(self.filepath)))
        return open_project_job(project, preview_size(context))

    def finish(self, context: bpy.types.Context, result: OpenedProject) -> None:
        show_project(context, result)
        self.report({"INFO"}, f"{len(result.project.photos)} photos, {len(result.region_faces)} regions")


class FRESCO_OT_save_project(JobOperator):
    bl_idname = "fresco.save_project"
    bl_label = "Save Project"
    bl_description = (
        "Write scan, photos, regions and settings to a project file, which fresco run takes; marks that are "
        "in no file yet become masks beside it"
    )
    step = "scan"

    filepath: bpy.props.StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: bpy.props.StringProperty(default="*.toml", options={"HIDDEN"})
    check_existing: bpy.props.BoolProperty(default=True, options={"HIDDEN"})

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not has_scan(cls, context):
            return False
        cls.poll_message_set("Import photos first (step 2), and leave Edit Mode")
        return len(context.scene.fresco.photos) > 0 and context.mode == "OBJECT"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.filepath:
            return super().invoke(context, event)
        self.filepath = f"{context.scene.fresco.export.default_name(context.scene)}.toml"
        return self.choose_file(context)

    def start(self, context: bpy.types.Context) -> Job[None]:
        scene = context.scene
        self.written = Path(bpy.path.abspath(self.filepath)).with_suffix(".toml")
        project = read_project(scene, self.written)
        survey, offset = read_points(scene), read_offset(scene)
        survey = replace(survey, points=survey.points + offset)
        hiding = {other.name: (other.vertices + offset, other.faces) for other in read_occluders(scene)}
        return saved_job(project, keep_scan(scene), survey, hiding)

    def finish(self, context: bpy.types.Context, result: None) -> None:
        self.report({"INFO"}, f"{self.written} written")


def saved_job(
    project: Project, kept: KeptScan | None, survey: Survey, occluders: Mapping[str, Triangles]
) -> Job[None]:
    """Write a project with what is only in the .blend."""
    if kept is None:
        raise ScanError(
            f"{project.scan.path.name} has faces with more than three corners: triangulate the scan first "
            "(Edit Mode, Face > Triangulate Faces)."
        )
    finding = one_step_job(kept.face_regions, "Writing down where the regions lie")
    regions = yield from part(beside_job(finding), 0.0, 0.3)
    unsaved = Unsaved(regions, kept.point_labels(), survey, occluders)
    yield from part(save_project_job(project, unsaved), 0.3, 1.0)


class FRESCO_FH_project(bpy.types.FileHandler):
    bl_idname = "FRESCO_FH_project"
    bl_label = "Fresco project"
    bl_import_operator = "fresco.open_project"
    bl_file_extensions = ".toml"

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return context.area is not None and context.area.type == "VIEW_3D"


CLASSES = (FRESCO_OT_open_project, FRESCO_OT_save_project, FRESCO_FH_project)
