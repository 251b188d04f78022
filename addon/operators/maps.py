"""Maps of the texture in the 3D view, what is covered, and where to stand for the next photos."""

from __future__ import annotations

from typing import Any

import bpy

from ...core.jobs import Job
from ...core.report.maps import FACE_MAPS
from ...core.texture.coverage import Standpoint, measure_coverage, next_standpoints_job
from ..bridge import maps as bridge
from ..bridge.photos import read_camera
from ..bridge.texture import read_texture
from ..jobs import JobOperator, StepOperator
from .regions import has_faces

NAMES = {
    "view": ("Photo", "Which photo every face shows"),
    "runner_up": ("Second Best", "Which photo would take its place"),
    "view_count": ("Number of Photos", "How many photos see the face"),
    "texel_size": ("Pixel Size", "Size of the photo's pixel on the surface"),
    "angle": ("Angle", "Angle between viewing ray and surface normal"),
    "blur": ("Blur", "Blur of the photo at the face's distance"),
    "predicted_shift": ("Shift to Others", "How far the photo disagrees with the others"),
    "pose_shift": ("Pose Uncertainty", "How far the texture may lie off, from the poses' uncertainty"),
}
MAPS = [(name, *NAMES[name]) for name in FACE_MAPS]


def is_textured(cls: type, context: bpy.types.Context) -> bool:
    """Poll: the scan has a texture and may be written."""
    if context.mode != "OBJECT":
        cls.poll_message_set("Leave Edit Mode first")
        return False
    if not has_faces(cls, context):
        return False
    cls.poll_message_set("Texture the scan first (step 6)")
    return bool(context.scene.fresco.texture_report)


class FRESCO_OT_show_map(StepOperator):
    bl_idname = "fresco.show_map"
    bl_label = "Show Map"
    bl_description = "Colour the scan by what is known of its texture, with a legend"
    bl_options = {"REGISTER", "UNDO"}
    step = "texture"

    field: bpy.props.EnumProperty(name="Map", items=MAPS)

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        return is_textured(cls, context)

    def run(self, context: bpy.types.Context) -> set[str] | None:
        found = FACE_MAPS[self.field](read_texture(context.scene))
        if found is None:
            self.warn(context, f"{NAMES[self.field][0]}: nothing is known of it for this texture.")
            return {"CANCELLED"}
        bridge.write_map(context.scene, found)
        space = context.space_data
        if space is not None and space.type == "VIEW_3D":
            space.shading.type = "SOLID"
            space.shading.light = "FLAT"
            space.shading.color_type = "VERTEX"
        return None


class FRESCO_OT_next_standpoints(JobOperator):
    bl_idname = "fresco.next_standpoints"
    bl_label = "Where to Shoot Next"
    bl_description = (
        "Find places for further photos with the chosen photo's lens: those that would add most surface in "
        "the wanted pixel size. Each becomes a camera that says what it adds"
    )
    bl_options = {"UNDO"}
    step = "texture"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not is_textured(cls, context):
            return False
        photo = context.scene.fresco.active_photo
        cls.poll_message_set("Choose a photo with the lens that will be used")
        return photo is not None and bool(photo.camera_json)

    def start(self, context: bpy.types.Context) -> Job[Any]:
        fresco = context.scene.fresco
        textured = read_texture(context.scene)
        self._camera = read_camera(fresco.active_photo)
        wanted = fresco.maps.wanted_texel
        selection = textured.selection
        coverage = measure_coverage(textured.vertices, textured.faces, selection, wanted)
        fresco.maps.coverage = "\n".join("\t".join(row) for row in bridge.coverage_rows(coverage, wanted))
        return next_standpoints_job(
            textured.vertices, textured.faces, selection, self._camera, wanted, fresco.maps.count
        )

    def finish(self, context: bpy.types.Context, result: list[Standpoint]) -> None:
        bridge.write_standpoints(context, result, self._camera)
        if not result:
            self.warn(context, "No place was found that would add to the texture in this pixel size.")
            return
        self.report({"INFO"}, f"{len(result)} places, the first adds {result[0].gain:.2f} m²")


CLASSES = (FRESCO_OT_show_map, FRESCO_OT_next_standpoints)
