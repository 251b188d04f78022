"""How good the marked regions are and how sure the pose will be: told while marking, computed in a thread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import bpy

from ...core.cameras import Camera
from ...core.errors import FrescoError
from ...core.jobs import Job, Progress, part
from ...core.pose import Pose
from ...core.pose.regions.estimate import estimate_pose_job
from ...core.project.stages.poses import ambiguity
from ...core.regions import ImageRegion, SurfaceRegion
from ...core.regions.feedback import RegionQuality, expected_covariance, pose_advice, region_quality
from ...core.settings import PoseSettings
from ..background import Signature
from ..bridge import photos as bridge
from ..bridge.images import MaskSource, mask_source
from ..bridge.regions import SurfaceSource, surface_source
from ..properties import FrescoPhoto
from ..settings import to_core


@dataclass(frozen=True, eq=False)
class Advice:
    """What to tell: quality of each region marked in the photo, by name, and a sentence on the pose."""

    qualities: Mapping[str, RegionQuality]
    pose: str


@dataclass(frozen=True, eq=False)
class Marked:
    """A photo's camera and marks (name -> mask, hidden part), and its pose where it was given by hand."""

    camera: Camera
    marks: Mapping[str, tuple[MaskSource, MaskSource | None]]
    given: Pose | None


def advice_signature(scene: bpy.types.Scene) -> Signature:
    """Tell whether anything has changed that the advice depends on; empty when there is nothing to tell."""
    photo, scan = scene.fresco.active_photo, scene.fresco.scan
    editing = scan is not None and scan.mode == "EDIT"  # attributes can only be read outside
    if photo is None or not photo.camera_json or editing:
        return ()
    regions = tuple(
        (r.uid, r.name, r.revision, r.face_count, hash(r.opening_json), _mark_signature(photo, r.uid))
        for r in scene.fresco.regions
    )
    shown = "" if scan is None else scan.name
    return photo.name, hash(photo.camera_json), hash(photo.pose_json), photo.state, shown, regions


def _mark_signature(photo: FrescoPhoto, uid: int) -> Signature:
    mark = photo.mark(uid)
    if mark is None or mark.image is None:
        return ()
    return mark.image.session_uid, mark.hidden.session_uid if mark.hidden is not None else 0


def read_marked(scene: bpy.types.Scene, photo: FrescoPhoto) -> Marked:
    """Take a photo's marks out of Blender."""
    names = {region.uid: region.name for region in scene.fresco.regions}
    marks = {
        names[mark.region_id]: (
            mask_source(mark.image),
            None if mark.hidden is None else mask_source(mark.hidden),
        )
        for mark in photo.marks
        if mark.image is not None and mark.region_id in names
    }
    given = bridge.read_solution(scene, photo).pose if photo.state == "GIVEN" else None
    return Marked(bridge.read_camera(photo), marks, given)


def advice_job(scene: bpy.types.Scene) -> Job[Advice]:
    """Advise on the chosen photo. What Blender holds is taken at once, the job itself touches none of it."""
    marked = read_marked(scene, scene.fresco.active_photo)
    on_scan = any(region.is_on_scan for region in scene.fresco.regions)
    source = surface_source(scene) if on_scan and scene.fresco.scan is not None else None
    return _advice_job(marked, source, to_core(scene.fresco.pose, PoseSettings))


def _advice_job(marked: Marked, source: SurfaceSource | None, settings: PoseSettings) -> Job[Advice]:
    camera = marked.camera
    images, qualities = [], {}
    for number, (name, (mask, hidden)) in enumerate(marked.marks.items()):
        yield Progress(0.3 * number / len(marked.marks), f"Judging {name}")
        region = ImageRegion.from_mask(mask.read(), name, None if hidden is None else hidden.read())
        qualities[name] = region_quality(region, camera.width, camera.height)
        images.append(region)
    surfaces = {} if source is None else source.regions()
    pairs = [(image, surfaces[image.name]) for image in images if image.name in surfaces]
    if not pairs:
        return Advice(qualities, partner_advice(images, surfaces))
    return Advice(qualities, (yield from part(_pose_job(marked, pairs, settings), 0.3, 1.0)))


def partner_advice(images: Sequence[ImageRegion], surfaces: Mapping[str, SurfaceRegion]) -> str:
    """Say what is missing before a pose can be expected."""
    if not images and not surfaces:
        return "Mark a region in the photo and on the scan."
    if not images:
        return "Mark the regions of the scan in this photo, too."
    return "Mark the same region on the scan, too, or let partners be proposed."


def _pose_job(
    marked: Marked, pairs: Sequence[tuple[ImageRegion, SurfaceRegion]], settings: PoseSettings
) -> Job[str]:
    """Sentence on the pose that the pairs give, found as the solver finds it, but not kept."""
    images, surfaces = [image for image, _ in pairs], [surface for _, surface in pairs]
    try:
        if marked.given is not None:
            at = marked.given.rotation, marked.given.translation
            covariance = expected_covariance(marked.camera, *at, surfaces)
            return pose_advice(covariance, *at, surfaces)
        pose = yield from estimate_pose_job(marked.camera, images, surfaces, settings=settings)
        if pose.ambiguous:
            return ambiguity(pose)
        told = pose_advice(pose.covariance, pose.rotation, pose.translation, surfaces)
        return f"Overlap error {pose.overlap_error:.1f} %. {told}"
    except FrescoError as error:
        return str(error)
