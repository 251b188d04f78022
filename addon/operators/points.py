"""Surveyed points: read, picked in photos and on the scan, found as markers; poses from them."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d

from ...core.arrays import ByteArray, FloatArray
from ...core.errors import PhotoError, PoseNotFound
from ...core.jobs import Job, Progress
from ...core.photos import read_image
from ...core.pose.points.markers import Marker, snap_to_corner
from ...core.pose.points.survey import read_survey
from ...core.project import PhotoPose
from ...core.project.stages.point_poses import (
    MARKERS,
    find_markers,
    match_markers,
    pose_from_points_job,
)
from ...core.settings import PointSettings
from ..background import Preparation, one_step_job
from ..bridge import photos as photos_bridge
from ..bridge import points as bridge
from ..bridge.world import read_offset
from ..jobs import JobOperator, StepOperator
from ..settings import to_core
from ..tools.targets import photo_of, shown_photo, to_pixel
from .regions import has_scan

REACH = 40.0
"""Pixels within which a marker without name belongs to the point that a pose expects there."""


class FRESCO_OT_import_points(StepOperator):
    bl_idname = "fresco.import_points"
    bl_label = "Import Points"
    bl_description = "Read surveyed points, name, x, y, z in the scan's true coordinates, from a table"
    bl_options = {"UNDO"}
    step = "pose"

    filepath: bpy.props.StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})
    filter_glob: bpy.props.StringProperty(default="*.csv;*.txt", options={"HIDDEN"})

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        return has_scan(cls, context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def run(self, context: bpy.types.Context) -> None:
        survey = read_survey(Path(bpy.path.abspath(self.filepath)))
        offset = read_offset(context.scene)
        for name, point in zip(survey.names, survey.points - offset, strict=True):
            bridge.write_point(context.scene, name, point)
        self.report({"INFO"}, f"{len(survey.names)} points")


class FRESCO_OT_remove_point(StepOperator):
    bl_idname = "fresco.remove_point"
    bl_label = "Remove Point"
    bl_description = "Take the chosen point out of the list and out of all photos"
    bl_options = {"UNDO"}
    step = "pose"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("Choose a point in the list")
        return context.scene.fresco.active_point is not None

    def run(self, context: bpy.types.Context) -> None:
        bridge.remove_point(context.scene, context.scene.fresco.point_index)


class PickOperator(bpy.types.Operator):
    """Mixin: waits for one click in the right editor; ESC gives up."""

    area_type = ""
    hint = ""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.window_manager.modal_handler_add(self)
        context.workspace.status_text_set(f"{self.hint}      ESC gives up")
        context.window.cursor_modal_set("CROSSHAIR")
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type in {"ESC", "RIGHTMOUSE"}:
            return self.end(context, {"CANCELLED"})
        if event.type != "LEFTMOUSE" or event.value != "PRESS":
            return {"PASS_THROUGH"}
        area, region = _under(context, event, self.area_type)
        if region is None:
            return {"RUNNING_MODAL"}
        with context.temp_override(area=area, region=region):
            done = self.pick(bpy.context, event.mouse_x - region.x, event.mouse_y - region.y)
        return self.end(context, {"FINISHED"} if done else {"CANCELLED"})

    def end(self, context: bpy.types.Context, result: set[str]) -> set[str]:
        context.workspace.status_text_set(None)
        context.window.cursor_modal_restore()
        for area in context.screen.areas:
            area.tag_redraw()
        return result

    def pick(self, context: bpy.types.Context, x: float, y: float) -> bool:
        """Take the place in the region; return whether something was picked."""
        raise NotImplementedError


def _under(context: bpy.types.Context, event: bpy.types.Event, kind: str) -> tuple[Any, Any]:
    """Editor of a kind and its main region under the mouse."""
    for area in context.screen.areas:
        for region in area.regions if area.type == kind else ():
            inside = region.x <= event.mouse_x < region.x + region.width
            if region.type == "WINDOW" and inside and region.y <= event.mouse_y < region.y + region.height:
                return area, region
    return None, None


class FRESCO_OT_pick_in_photo(PickOperator):
    bl_idname = "fresco.pick_in_photo"
    bl_label = "Pick in Photo"
    bl_description = "Click the chosen point in a photo in an Image Editor; it snaps to the corner there"
    bl_options = {"UNDO"}
    area_type, hint = "IMAGE_EDITOR", "Click the point in the photo"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("Choose a point in the list")
        return context.scene.fresco.active_point is not None

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Begin to read the shown photos, while the user aims."""
        editors = [area.spaces.active for area in context.screen.areas if area.type == self.area_type]
        shown = [photo_of(context.scene, editor.image) for editor in editors]
        paths = {photo.path for photo in shown if photo is not None}
        self._read = {
            path: Preparation((), one_step_job(partial(read_image, Path(path)), "Reading the photo"))
            for path in paths
        }
        return super().invoke(context, event)

    def pick(self, context: bpy.types.Context, x: float, y: float) -> bool:
        photo = shown_photo(context)
        if photo is None or not photo.camera_json:
            self.report({"ERROR"}, "This Image Editor shows no photo of the list: choose one there.")
            return False
        pixel = to_pixel(context, x, y, photo.size)
        if not np.all((pixel >= -0.5) & (pixel < np.array(photo.size) - 0.5)):
            self.report({"ERROR"}, "The click is outside the photo: click where the photo shows the point.")
            return False
        read = self._read.get(photo.path)
        try:
            pixels = read_image(Path(photo.path)) if read is None else read.result()
        except PhotoError as error:
            self.report({"ERROR"}, str(error))
            return False
        pick_pixel(context.scene, photo, pixels, pixel)
        return True


def pick_pixel(scene: bpy.types.Scene, photo: Any, pixels: ByteArray, pixel: FloatArray) -> None:
    """Set the chosen point's pixel (2,) in a photo (H,W,3), snapped to the corner there if there is one."""
    snapped = snap_to_corner(pixels, pixel)
    bridge.write_pick(photo, scene.fresco.active_point.name, pixel if snapped is None else snapped)


class FRESCO_OT_pick_on_scan(PickOperator):
    bl_idname = "fresco.pick_on_scan"
    bl_label = "Pick on Scan"
    bl_description = "Click a place on the scan: it becomes a new point of the list"
    bl_options = {"UNDO"}
    area_type, hint = "VIEW_3D", "Click the point on the scan"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return has_scan(cls, context) and context.mode == "OBJECT"

    def pick(self, context: bpy.types.Context, x: float, y: float) -> bool:
        view = context.space_data.region_3d
        origin = region_2d_to_origin_3d(context.region, view, (x, y))
        point = bridge.point_on_scan(context, origin, region_2d_to_vector_3d(context.region, view, (x, y)))
        if point is None:
            self.report({"ERROR"}, "There is no scan at this place.")
            return False
        bridge.write_point(context.scene, bridge.next_name(context.scene), point)
        return True


class FRESCO_OT_find_markers(JobOperator):
    bl_idname = "fresco.find_markers"
    bl_label = "Find Markers"
    bl_description = (
        "Find markers in all photos and match them with the points: coded ones by their number, others by "
        "where a photo's pose expects the points"
    )
    bl_options = {"UNDO"}
    step = "pose"

    kind: bpy.props.EnumProperty(
        name="Markers", items=[(name, name.replace("-", " ").capitalize(), "") for name in MARKERS]
    )

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("Import the surveyed points first")
        return len(context.scene.fresco.points) > 0 and len(context.scene.fresco.photos) > 0

    def start(self, context: bpy.types.Context) -> Job[Any]:
        scene = context.scene
        items = [photo for photo in scene.fresco.photos if photo.use and photo.camera_json]
        self._names = [item.name for item in items]
        return markers_job([photos_bridge.read_photo(scene, item) for item in items], self.kind)

    def finish(self, context: bpy.types.Context, result: list[list[Marker]]) -> None:
        scene, survey, matched = context.scene, bridge.read_points(context.scene), 0
        for name, markers in zip(self._names, result, strict=True):
            item = scene.fresco.photos[name]
            start = photos_bridge.read_solution(scene, item).pose if item.is_posed else None
            photo = photos_bridge.read_photo(scene, item)
            for point, pixel in match_markers(photo, markers, survey, start, REACH).items():
                bridge.write_pick(item, point, np.array(pixel))
                matched += 1
        found = sum(map(len, result))
        self.report({"INFO"}, f"{found} markers found, {matched} of them are points of the list")
        if not matched:
            self.warn(context, f"None of the {found} markers found is a point of the list.")


def markers_job(photos: list[Any], kind: str) -> Job[list[list[Marker]]]:
    """Find the markers of photos one after the other."""
    found = []
    for number, photo in enumerate(photos):
        yield Progress(number / len(photos), f"Looking for markers in {photo.name}")
        found.append(find_markers(photo, kind))
    return found


class FRESCO_OT_pose_from_points(JobOperator):
    bl_idname = "fresco.pose_from_points"
    bl_label = "Pose from Points"
    bl_description = "Find where the chosen photo was taken, from the points that are picked in it"
    bl_options = {"UNDO"}
    step = "pose"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        photo = context.scene.fresco.active_photo
        cls.poll_message_set("Pick at least four points in the chosen photo")
        picked = 0 if photo is None else sum(pick.active for pick in photo.picks)
        return photo is not None and bool(photo.camera_json) and picked >= 4

    def start(self, context: bpy.types.Context) -> Job[PhotoPose]:
        scene = context.scene
        item = scene.fresco.active_photo
        if item.camera is None:
            raise PhotoError(f"{item.name}: its camera was deleted. Remove the photo and import it again.")
        photo, picks = photos_bridge.read_photo(scene, item), bridge.read_picks(item)
        settings = to_core(scene.fresco.point_settings, PointSettings)
        return pose_from_points_job(photo, bridge.read_points(scene), picks, settings)

    def finish(self, context: bpy.types.Context, result: PhotoPose) -> None:
        if not result.solved:
            raise PoseNotFound(f"{result.photo}: {result.failure}")
        item = context.scene.fresco.photos[result.photo]
        photos_bridge.write_solution(context.scene, item, result)
        bridge.write_residuals(item, result)
        bridge.write_check_residuals(context.scene, item)
        used = sum(point.used for point in result.points)
        self.report({"INFO"}, f"{result.photo}: {used} of {len(result.points)} points hold its pose")


CLASSES = (
    FRESCO_OT_import_points,
    FRESCO_OT_remove_point,
    FRESCO_OT_pick_in_photo,
    FRESCO_OT_pick_on_scan,
    FRESCO_OT_find_markers,
    FRESCO_OT_pose_from_points,
)
