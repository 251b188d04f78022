"""Refine poses by edges and all together; look at what it changed; go back to the pose before."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import bpy

from ...core.cameras.files.dictionary import camera_to_dict
from ...core.errors import PhotoError
from ...core.jobs import Job, Progress, part
from ...core.photos import Photo
from ...core.project import PhotoPose, RefineSettings, refine_poses_job
from ...core.project.stages.refinement import restored, view_of
from ...core.project.stages.residuals import EdgeResiduals, edge_residuals_job
from ...core.scans import Scan
from ...core.settings import EdgeSettings, JointSettings
from ..bridge import photos as bridge
from ..bridge.previews import preview_job
from ..bridge.scans import read_scan
from ..jobs import JobOperator
from ..overlays.residuals import RESIDUALS, PhotoEdges
from ..preferences import preview_size
from ..properties import FrescoPhoto
from ..settings import to_core
from .photos import OpenedPhoto
from .regions import has_faces

ADJUSTED = "Adjusted by what the photos show in common."


def refinable_photos(scene: bpy.types.Scene) -> list[FrescoPhoto]:
    """Photos in use that have a pose."""
    return [photo for photo in scene.fresco.photos if photo.use and photo.is_posed and photo.camera]


class RefineOperator(JobOperator):
    """Mixin: moves the poses of photos and says what came of it."""

    bl_options = {"UNDO"}
    step = "refine"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not has_faces(cls, context):
            return False
        if context.mode != "OBJECT":
            cls.poll_message_set("Leave Edit Mode first")
            return False
        cls.poll_message_set("No photo that is in use has a pose yet: solve the poses first (step 4)")
        return bool(refinable_photos(context.scene))

    def refine(
        self,
        context: bpy.types.Context,
        photos: list[FrescoPhoto],
        settings: RefineSettings,
        held: Collection[str],
    ) -> Job[list[PhotoPose]]:
        """Return the job that refines photos of the scene."""
        scene = context.scene
        context.view_layer.update()
        core_photos = [bridge.read_photo(scene, photo) for photo in photos]
        before = [bridge.read_solution(scene, photo) for photo in photos]
        job = refine_poses_job(read_scan(scene), core_photos, before, settings, held)
        return refined_job(job, core_photos, preview_size(context))

    def finish(self, context: bpy.types.Context, found: RefinedPhotos) -> None:
        photos, result = context.scene.fresco.photos, found.poses
        moved = 0
        for name, opened in found.cameras.items():
            bridge.write_camera(context, photos[name], opened.camera, opened.note, opened.preview)
        for refined in result:
            item = photos[refined.photo]
            if item.hold or not refined.refinements:
                continue
            bridge.write_solution(context.scene, item, refined)
            moved += refined.refinements[-1].moved
        kept = [pose for pose in result if pose.refinements and not pose.refinements[-1].moved]
        self.report({"INFO"}, f"{moved} of {len(result)} poses refined")
        if kept and not moved:
            self.warn(context, f"{kept[0].photo}: {kept[0].refinements[-1].note}")
        lenses = dict.fromkeys(p.refinements[-1].lens for p in result if p.refinements)
        if told := [sentence for sentence in lenses if sentence]:
            self.report({"INFO"}, "Lenses: " + "; ".join(told))


@dataclass(frozen=True, eq=False)
class RefinedPhotos:
    """What became of the photos, and the cameras that were adjusted, by photo."""

    poses: list[PhotoPose]
    cameras: dict[str, OpenedPhoto]


def refined_job(job: Job[list[PhotoPose]], photos: Sequence[Photo], size: int) -> Job[RefinedPhotos]:
    """Refine, and make the backgrounds of photos whose lens was adjusted."""
    poses = yield from part(job, 0.0, 0.9)
    changed = [
        (photo, pose)
        for photo, pose in zip(photos, poses, strict=True)
        if pose.camera is not None and camera_to_dict(pose.camera) != camera_to_dict(photo.camera)
    ]
    opened = {}
    for number, (photo, pose) in enumerate(changed):
        span = 0.9 + 0.1 * number / len(changed), 0.9 + 0.1 * (number + 1) / len(changed)
        opened[photo.name] = yield from part(adjusted_job(photo, pose.camera, ADJUSTED, size), *span)
    return RefinedPhotos(poses, opened)


def adjusted_job(photo: Photo, camera: Any, note: str, size: int) -> Job[OpenedPhoto]:
    """Make the background of a photo for another camera."""
    preview = yield from preview_job(photo.path, camera, size)
    return OpenedPhoto(photo.path, camera, note, preview)


class FRESCO_OT_refine_edges(RefineOperator):
    bl_idname = "fresco.refine_edges"
    bl_label = "Refine by Edges"
    bl_description = "Move each pose until the edges of the scan fall on those of the photo"

    only_active: bpy.props.BoolProperty(
        name="Only the Chosen Photo", description="Refine the photo chosen in the list", options={"SKIP_SAVE"}
    )

    @classmethod
    def description(cls, context: bpy.types.Context, properties: Any) -> str:
        return "Refine only the photo chosen in the list" if properties.only_active else cls.bl_description

    def start(self, context: bpy.types.Context) -> Job[Any]:
        fresco = context.scene.fresco
        photos = [photo for photo in refinable_photos(context.scene) if not photo.hold]
        if self.only_active:
            chosen = fresco.active_photo
            photos = [photo for photo in refinable_photos(context.scene) if photo == chosen]
            if not photos:
                raise PhotoError(f"{chosen.name}: solve its pose first, or place its camera and accept it.")
            if chosen.hold:
                raise PhotoError(
                    f"{chosen.name}: its pose is held. Take the tick at “Hold” away to refine it."
                )
        if not photos:
            raise PhotoError("All poses are held: take the tick at “Hold” away from those to be refined.")
        settings = RefineSettings(edges=to_core(fresco.edges, EdgeSettings))
        return self.refine(context, photos, settings, ())


class FRESCO_OT_refine_jointly(RefineOperator):
    bl_idname = "fresco.refine_jointly"
    bl_label = "Refine All Together"
    bl_description = (
        "Tie all photos by what they show of the same surface, and move their poses until that agrees on the "
        "scan"
    )

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        if not super().ready(context):
            return False
        cls.poll_message_set("Only one photo has a pose: there is nothing to tie it to")
        return len(refinable_photos(context.scene)) > 1

    def start(self, context: bpy.types.Context) -> Job[Any]:
        photos = refinable_photos(context.scene)
        held = {photo.name for photo in photos if photo.hold}
        if len(held) == len(photos):
            raise PhotoError("All poses are held: take the tick at “Hold” away from those to be refined.")
        fresco = context.scene.fresco
        settings = RefineSettings(joint=to_core(fresco.joint, JointSettings), lenses=fresco.compare.lenses)
        return self.refine(context, photos, settings, held)


class FRESCO_OT_restore_pose(JobOperator):
    bl_idname = "fresco.restore_pose"
    bl_label = "Restore Pose Before"
    bl_description = "Give the chosen photo back the pose that it had before its last refinement"
    bl_options = {"UNDO"}
    step = "refine"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        photo = context.scene.fresco.active_photo
        cls.poll_message_set("The chosen photo was not refined")
        return photo is not None and photo.camera is not None and photo.is_refined

    def start(self, context: bpy.types.Context) -> Job[Any]:
        item = context.scene.fresco.active_photo
        before = restored(bridge.read_solution(context.scene, item))
        photo = bridge.read_photo(context.scene, item)
        return refined_job(given_job(before), [photo], preview_size(context))

    def finish(self, context: bpy.types.Context, found: RefinedPhotos) -> None:
        (before,) = found.poses
        item = context.scene.fresco.photos[before.photo]
        for opened in found.cameras.values():
            bridge.write_camera(
                context, item, opened.camera, "Lens as before it was adjusted.", opened.preview
            )
        bridge.write_solution(context.scene, item, before)


def given_job(pose: PhotoPose) -> Job[list[PhotoPose]]:
    """Return a pose that is known already."""
    yield Progress(0.0, "Going back to the pose before")
    return [pose]


class FRESCO_OT_show_residuals(JobOperator):
    bl_idname = "fresco.show_residuals"
    bl_label = "Show Edges on Photo"
    bl_description = (
        "Draw the scan's edges over the chosen photo, as its pose before and after refinement puts them, and "
        "how far off the photo shows them"
    )
    step = "refine"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        photo = context.scene.fresco.active_photo
        if not has_faces(cls, context):
            return False
        cls.poll_message_set("Choose a photo that has a pose")
        return photo is not None and photo.camera is not None and photo.is_posed

    def start(self, context: bpy.types.Context) -> Job[Any]:
        scene = context.scene
        context.view_layer.update()
        photo = scene.fresco.active_photo
        self._photo = photo.name
        after = bridge.read_solution(scene, photo)
        before = PhotoPose(after.photo, after.first_pose, given=after.given)
        settings = to_core(scene.fresco.edges, EdgeSettings)
        return both_residuals_job(bridge.read_photo(scene, photo), before, after, read_scan(scene), settings)

    def finish(self, context: bpy.types.Context, result: tuple[EdgeResiduals, EdgeResiduals]) -> None:
        scene = context.scene
        photo = scene.fresco.photos[self._photo]
        RESIDUALS[photo.name] = PhotoEdges.of(scene, photo, *result)
        scene.fresco.compare.edges = True
        show_photo(context, photo)


def both_residuals_job(
    photo: Any, before: PhotoPose, after: PhotoPose, scan: Scan, settings: EdgeSettings
) -> Job[tuple[EdgeResiduals, EdgeResiduals]]:
    """Find the edges and residuals of a photo at the pose before refinement, and now."""
    first = yield from part(edge_residuals_job(view_of(photo, before), scan, settings), 0.0, 0.5)
    second = yield from part(edge_residuals_job(view_of(photo, after), scan, settings), 0.5, 1.0)
    return first, second


def show_photo(context: bpy.types.Context, photo: FrescoPhoto) -> None:
    """Look at a photo: in the Image Editors of this screen, and through its camera in this 3D view."""
    bridge.frame_photo(context.scene, photo)
    for area in context.screen.areas if context.screen is not None else ():
        if area.type == "IMAGE_EDITOR":
            area.spaces.active.image = photo.image
        area.tag_redraw()
    space = context.space_data
    if space is not None and space.type == "VIEW_3D":
        space.region_3d.view_perspective = "CAMERA"


CLASSES = (
    FRESCO_OT_refine_edges,
    FRESCO_OT_refine_jointly,
    FRESCO_OT_restore_pose,
    FRESCO_OT_show_residuals,
)
