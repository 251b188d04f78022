"""Find the cameras' poses from the regions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

from ...core.errors import RegionError
from ...core.jobs import Job, part
from ...core.photos import Photo
from ...core.pose import Pose
from ...core.project import PhotoPose, solve_poses_job
from ...core.settings import PoseSettings
from ..background import beside_job, one_step_job
from ..bridge import photos as bridge
from ..bridge.regions import SurfaceSource, surface_source
from ..jobs import JobOperator, StepOperator
from ..properties import FrescoPhoto
from ..settings import to_core
from .regions import has_scan


def solvable_photos(scene: bpy.types.Scene) -> list[FrescoPhoto]:
    """Photos in use with a camera, a calibration and at least one region that the scan has."""
    with_faces = {region.uid for region in scene.fresco.regions if region.is_on_scan}
    return [
        photo
        for photo in scene.fresco.photos
        if photo.use
        and photo.camera is not None
        and photo.camera_json
        and any(mark.region_id in with_faces for mark in photo.marks)
    ]


class FRESCO_OT_solve_poses(JobOperator):
    bl_idname = "fresco.solve_poses"
    bl_label = "Solve Poses"
    bl_description = "Find where each camera stood, from the regions that photo and scan both show"
    bl_options = {"UNDO"}
    step = "pose"

    only_active: bpy.props.BoolProperty(
        name="Only the Chosen Photo", description="Solve the photo chosen in the list", options={"SKIP_SAVE"}
    )

    @classmethod
    def description(cls, context: bpy.types.Context, properties: Any) -> str:
        return "Solve only the photo chosen in the list" if properties.only_active else cls.bl_description

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not has_scan(cls, context):
            return False
        if context.mode != "OBJECT":
            cls.poll_message_set("Leave Edit Mode first")
            return False
        cls.poll_message_set("No photo has a calibrated camera and a region with faces on the scan (step 3)")
        return bool(solvable_photos(context.scene))

    def start(self, context: bpy.types.Context) -> Job[Any]:
        scene = context.scene
        photos = solvable_photos(scene)
        if self.only_active:
            chosen = scene.fresco.active_photo
            photos = [photo for photo in photos if photo == chosen]
            if not photos:
                raise RegionError(
                    f"{chosen.name}: mark a region in this photo first, and calibrate its camera."
                )
        self._photos = [photo.name for photo in photos]
        core_photos = [bridge.read_photo(scene, photo) for photo in photos]
        return posed_job(core_photos, surface_source(scene), to_core(scene.fresco.pose, PoseSettings))

    def finish(self, context: bpy.types.Context, result: list[PhotoPose]) -> None:
        photos = context.scene.fresco.photos
        for solved in result:
            bridge.write_solution(context.scene, photos[solved.photo], solved)
        found = sum(solved.solved for solved in result)
        self.report({"INFO"}, f"{found} of {len(self._photos)} photos solved")


def posed_job(photos: Sequence[Photo], source: SurfaceSource, settings: PoseSettings) -> Job[list[PhotoPose]]:
    """Make the scan's regions, and solve the poses of photos by them."""
    made = beside_job(one_step_job(source.regions, "Taking the outlines of the scan's regions"))
    surfaces = yield from part(made, 0.0, 0.05)
    return (yield from part(solve_poses_job(photos, surfaces, settings), 0.05, 1.0))


class FRESCO_OT_next_candidate(StepOperator):
    bl_idname = "fresco.next_candidate"
    bl_label = "Next Candidate"
    bl_description = (
        "Show the next pose that explains the chosen photo's regions as well; accept the right one"
    )
    bl_options = {"UNDO"}
    step = "pose"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        photo = context.scene.fresco.active_photo
        cls.poll_message_set("The chosen photo has only one pose")
        return photo is not None and photo.camera is not None and len(bridge.read_candidates(photo)) > 1

    def run(self, context: bpy.types.Context) -> None:
        photo = context.scene.fresco.active_photo
        count = len(bridge.read_candidates(photo))
        bridge.show_candidate(context.scene, photo, (photo.candidate + 1) % count)


class FRESCO_OT_accept_pose(StepOperator):
    bl_idname = "fresco.accept_pose"
    bl_label = "Accept Pose"
    bl_description = "Use the chosen photo's camera where it stands now, found, ambiguous or placed by hand"
    bl_options = {"UNDO"}
    step = "pose"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        photo = context.scene.fresco.active_photo
        cls.poll_message_set("Choose a photo with a calibrated camera in the list")
        return photo is not None and photo.camera is not None and bool(photo.camera_json)

    def run(self, context: bpy.types.Context) -> None:
        photo = context.scene.fresco.active_photo
        context.view_layer.update()
        rotation, translation, covariance = bridge.read_pose(context.scene, photo)
        unknown = np.full((6, 6), np.nan)
        pose = Pose(rotation, translation, unknown if covariance is None else covariance)
        accepted = PhotoPose(photo.name, pose, notes=("Accepted by hand.",), given=True)
        bridge.write_solution(context.scene, photo, accepted)


CLASSES = (FRESCO_OT_solve_poses, FRESCO_OT_next_candidate, FRESCO_OT_accept_pose)
