"""Photos between the scene and core: each is an item of the list with a camera object and its background.

Poses are kept with the photo (`pose_json`) in true world coordinates and double precision; functions take and
give them in Blender's world, the scan's local frame. The camera object shows them; one that was moved by hand
since then counts as it stands.
"""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

from ...core.arrays import ByteArray, FloatArray
from ...core.cameras import Camera
from ...core.cameras.files import camera_from_dict, camera_to_dict
from ...core.errors import PhotoError
from ...core.photos import Photo, RegionMark, View
from ...core.pose import Pose
from ...core.project.stages.photo_pose import PhotoPose, pose_from_dict, pose_to_dict
from ..properties import FrescoMark, FrescoPhoto
from . import cameras
from .images import load_image, pack_photo, read_mask_pixels
from .world import collection, matrix_to_array, read_offset

COLLECTION = "Photos"
_MOVED = 1e-4  # largest difference of matrix entries (m, or of a rotation) that is Blender's rounding


def add_photo(context: bpy.types.Context, path: Path, name: str) -> FrescoPhoto:
    """Add a photo to the list, with a camera object that is not calibrated yet."""
    item = context.scene.fresco.photos.add()
    item.name = unique_name(context.scene, name)
    item.image = load_image(path)
    item.camera = bpy.data.objects.new(item.name, bpy.data.cameras.new(item.name))
    collection(context.scene, COLLECTION).objects.link(item.camera)
    stand_before_scan(context.scene, item.camera)
    return item


def unique_name(scene: bpy.types.Scene, name: str) -> str:
    """Return the name, numbered if another photo has it."""
    taken = {photo.name for photo in scene.fresco.photos}
    number, unique = 2, name
    while unique in taken:
        number, unique = number + 1, f"{name} ({number})"
    return unique


def remove_camera(item: FrescoPhoto) -> None:
    """Remove a photo's camera object from the file, if it is still there."""
    if item.camera is None:
        return
    data = item.camera.data
    bpy.data.objects.remove(item.camera)
    if data.users == 0:
        bpy.data.cameras.remove(data)


def write_camera(
    context: bpy.types.Context, item: FrescoPhoto, camera: Camera, source: str, preview: ByteArray | None
) -> None:
    """Give a photo its calibration; `preview` is its undistorted copy, None where it needs none."""
    item.camera_json = json.dumps(camera_to_dict(camera))
    item.camera_source = source
    cameras.write_calibration(item.camera.data, camera)
    backgrounds = item.camera.data.background_images
    old = backgrounds[0].image if backgrounds else None
    shown = item.image if preview is None else pack_photo(f"{item.name} undistorted", preview)
    cameras.show_background(item.camera.data, shown)
    if old is not None and old.packed_file is not None and old != shown and old.users == 0:
        bpy.data.images.remove(old)


def read_camera(item: FrescoPhoto) -> Camera:
    """Return the photo's calibrated camera; `PhotoError` if it has none."""
    if not item.camera_json:
        raise PhotoError(f"{item.name}: the camera has no calibration yet. Set it in the list of photos.")
    return camera_from_dict(json.loads(item.camera_json))


def link_camera(scene: bpy.types.Scene, item: FrescoPhoto) -> None:
    """Bring a camera back that was deleted from the scene; the list of photos has kept it."""
    if item.camera.name not in scene.objects:
        collection(scene, COLLECTION).objects.link(item.camera)


def frame_photo(scene: bpy.types.Scene, item: FrescoPhoto) -> None:
    """Make a photo's camera the scene's, with the render size of the photo."""
    link_camera(scene, item)
    scene.camera = item.camera
    if item.camera_json:
        cameras.apply_frame(scene, cameras.frame_of(read_camera(item)))


def stand_before_scan(scene: bpy.types.Scene, camera: bpy.types.Object) -> None:
    """Put a camera without pose in front of the scan, looking north at it."""
    scan = scene.fresco.scan
    centre, size = np.zeros(3), 2.0
    if scan is not None:
        corners = np.array([scan.matrix_world @ Vector(corner) for corner in scan.bound_box])
        centre, size = corners.mean(axis=0), float(np.ptp(corners, axis=0).max())
    camera.data.display_size = 0.08 * size
    camera.location = centre - (0.0, 1.5 * size, 0.0)
    camera.rotation_euler = (np.pi / 2, 0.0, 0.0)


def write_pose(
    scene: bpy.types.Scene,
    item: FrescoPhoto,
    rotation: FloatArray,
    translation: FloatArray,
    covariance: FloatArray | None = None,
) -> None:
    """Keep a photo's pose, given in Blender's world (3,3), (3,) metres, and move its camera there."""
    in_world = translation - rotation @ read_offset(scene)
    pose = {"rotation": rotation.tolist(), "translation": in_world.tolist()}
    if covariance is not None:
        pose["covariance"] = covariance.tolist()
    item.pose_json = json.dumps(pose)
    link_camera(scene, item)
    cameras.write_pose(item.camera, rotation, translation)


def write_world_pose(
    scene: bpy.types.Scene, item: FrescoPhoto, rotation: FloatArray, translation: FloatArray
) -> None:
    """Keep a pose that is given in true world coordinates."""
    write_pose(scene, item, rotation, translation + rotation @ read_offset(scene))


def write_solution(scene: bpy.types.Scene, item: FrescoPhoto, solved: PhotoPose) -> None:
    """Show what became of a photo in the pose stage; a pose that does not count is shown, too."""
    item.message = " ".join(text for text in (solved.failure, *solved.notes) if text)
    item.solution_json, item.candidate = json.dumps(pose_to_dict(solved)), 0
    item.overlap, item.centre_sigma, item.rotation_sigma = -1.0, 0.0, 0.0
    item.refined = len(solved.refinements)
    joint = [step.score_after for step in solved.refinements if step.method == "joint"]
    item.joint_shift = joint[-1] if joint and np.isfinite(joint[-1]) else -1.0
    pose = solved.pose
    if pose is None:
        item.state, item.pose_json = "FAILED", ""
        return
    item.state = "GIVEN" if solved.given else "SOLVED" if solved.solved else "AMBIGUOUS"
    if solved.overlap_error is not None:
        item.overlap = solved.overlap_error
    covariance = None
    if solved.sure_pose is not None:
        item.centre_sigma, item.rotation_sigma = pose.centre_sigma, pose.rotation_sigma
        covariance = pose.covariance
    write_pose(scene, item, pose.rotation, pose.translation, covariance)


def read_candidates(item: FrescoPhoto) -> list[Pose]:
    """Return all poses that the solver found for a photo, the best first; none before it is solved."""
    if not item.solution_json:
        return []
    pose = pose_from_dict(json.loads(item.solution_json)).pose
    return [] if pose is None else [pose, *getattr(pose, "alternatives", ())]


def show_candidate(scene: bpy.types.Scene, item: FrescoPhoto, number: int) -> None:
    """Move a photo's camera to another one of the solver's poses."""
    pose = read_candidates(item)[number]
    item.candidate = number
    item.overlap = pose.overlap_error
    item.centre_sigma, item.rotation_sigma = pose.centre_sigma, pose.rotation_sigma
    write_pose(scene, item, pose.rotation, pose.translation, pose.covariance)


def read_solution(scene: bpy.types.Scene, item: FrescoPhoto) -> PhotoPose:
    """Return what became of a photo; a pose that was placed or accepted by hand counts as given."""
    if item.is_posed and (not item.solution_json or is_moved(scene, item)):
        rotation, translation, covariance = read_pose(scene, item)
        unknown = np.full((6, 6), np.nan)
        pose = Pose(rotation, translation, unknown if covariance is None else covariance)
        return PhotoPose(item.name, pose, given=True)
    if item.solution_json:
        return pose_from_dict(json.loads(item.solution_json))
    return PhotoPose(item.name, None, "Not solved yet.")


def _kept_pose(scene: bpy.types.Scene, item: FrescoPhoto) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    pose = json.loads(item.pose_json)
    rotation, in_world = np.array(pose["rotation"]), np.array(pose["translation"])
    covariance = np.array(pose["covariance"]) if "covariance" in pose else None
    return rotation, in_world + rotation @ read_offset(scene), covariance


def read_pose(scene: bpy.types.Scene, item: FrescoPhoto) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Rotation, translation (Blender's world, metres) and covariance, as kept or as the camera stands."""
    if is_moved(scene, item):
        return (*cameras.read_pose(item.camera), None)
    return _kept_pose(scene, item)


def is_moved(scene: bpy.types.Scene, item: FrescoPhoto) -> bool:
    """Whether the camera object stands elsewhere than the pose that is kept."""
    if not item.pose_json:
        return True
    rotation, translation, _ = _kept_pose(scene, item)
    stands = matrix_to_array(item.camera.matrix_world)
    return bool(np.abs(stands - cameras.pose_matrix(rotation, translation)).max() > _MOVED)


def read_mark(scene: bpy.types.Scene, mark: FrescoMark) -> RegionMark | None:
    """Return core's mark of a region in a photo; None where the region or the mask is gone."""
    region = next((r for r in scene.fresco.regions if r.uid == mark.region_id), None)
    if region is None or mark.image is None:
        return None
    hidden = None if mark.hidden is None else read_mask_pixels(mark.hidden)
    if mark.image.filepath and not mark.image.is_dirty and mark.image.packed_file is None:
        return RegionMark(region.name, path=Path(bpy.path.abspath(mark.image.filepath)), hidden=hidden)
    return RegionMark(region.name, mask=read_mask_pixels(mark.image), hidden=hidden)


def read_photo(scene: bpy.types.Scene, item: FrescoPhoto) -> Photo:
    """Return core's photo with its calibration and marks."""
    marks = (read_mark(scene, mark) for mark in item.marks)
    return Photo(
        path=Path(item.path),
        name=item.name,
        camera=read_camera(item),
        regions=tuple(mark for mark in marks if mark is not None),
        mask=Path(bpy.path.abspath(item.mask.filepath)) if item.mask is not None else None,
    )


def read_view(scene: bpy.types.Scene, item: FrescoPhoto) -> View:
    """Return core's posed photo in Blender's world, which is the scan's local frame."""
    rotation, translation, covariance = read_pose(scene, item)
    photo = read_photo(scene, item)
    return View(photo.camera, rotation, translation, photo.path, photo.name, photo.read_mask(), covariance)
