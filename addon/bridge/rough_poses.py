"""What is known of a photo's pose before it is solved: satellites, neighbours, a camera placed by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...core.arrays import FloatArray
from ...core.errors import PhotoError, RegionError
from ...core.geometry.rigid import camera_centre
from ...core.photos.exif import read_exif
from ...core.photos.georeference import PlacedPhoto, georeference
from ...core.photos.position import Position, read_position
from ...core.photos.rough_pose import RoughPose, pose_as_known, pose_from_position, pose_like_neighbour
from ...core.settings import ScanSettings
from ..properties import FrescoPhoto
from ..settings import to_core
from . import meshes, photos
from .world import read_offset


@dataclass(frozen=True, eq=False)
class PositionSource:
    """A photo's file, and what tells how positions lie in the scan; taken out of Blender for threads.

    `solved` are files of solved photos with camera centre (3,) and viewing direction (3,); `bounds` (2,3) are
    the scan's. Places are in true world coordinates, m.
    """

    path: Path
    epsg: int | None
    solved: Sequence[tuple[Path, FloatArray, FloatArray]]
    bounds: FloatArray
    offset: FloatArray

    def tells_position(self) -> bool:
        """Whether the photo says where it was taken."""
        return _position(self.path) is not None

    def pose(self) -> RoughPose:
        """Rough pose of the photo in Blender's world; PhotoError where nothing tells one."""
        position = _position(self.path)
        if position is None:
            raise PhotoError(
                f"{self.path.name} does not tell where it was taken: it has no satellite position."
            )
        told = [(_position(path), centre, forward) for path, centre, forward in self.solved]
        placed = [PlacedPhoto(place, centre, forward) for place, centre, forward in told if place is not None]
        rough = pose_from_position(position, georeference(self.epsg, placed), self.bounds)
        translation = rough.translation + rough.rotation @ self.offset
        return RoughPose(rough.rotation, translation, rough.covariance, rough.source)


def _position(path: Path) -> Position | None:
    return read_position(path, read_exif(path))


def position_source(scene: bpy.types.Scene, photo: FrescoPhoto) -> PositionSource:
    """Take what tells a photo's rough pose out of Blender."""
    offset = read_offset(scene)
    settings = to_core(scene.fresco.scan_settings, ScanSettings)
    solved = []
    for other in scene.fresco.photos:
        if other.is_posed and other.name != photo.name:
            rotation, translation, _ = photos.read_pose(scene, other)
            solved.append((Path(other.path), camera_centre(rotation, translation) + offset, rotation[2]))
    return PositionSource(Path(photo.path), settings.epsg, solved, scan_bounds(scene) + offset, offset)


def scan_bounds(scene: bpy.types.Scene) -> FloatArray:
    """Least and largest coordinates (2,3) of the scan, Blender's world, m."""
    vertices = meshes.read_vertices(scene.fresco.scan)
    return np.stack([vertices.min(axis=0), vertices.max(axis=0)])


def known_poses(scene: bpy.types.Scene, photo: FrescoPhoto) -> list[RoughPose]:
    """Poses that a photo may have, alternatives to each other; none before it is solved or placed."""
    bounds = scan_bounds(scene)
    if photo.state == "AMBIGUOUS":
        found = photos.read_candidates(photo)
        return [pose_as_known(pose.rotation, pose.translation, pose.covariance, bounds) for pose in found]
    return [pose_as_known(*photos.read_pose(scene, photo), bounds)] if photo.is_posed else []


def placed_pose(scene: bpy.types.Scene, photo: FrescoPhoto) -> RoughPose:
    """Rough pose of a photo as its camera stands."""
    rotation, translation, _ = photos.read_pose(scene, photo)
    return pose_as_known(rotation, translation, None, scan_bounds(scene))


def neighbour_pose(scene: bpy.types.Scene, photo: FrescoPhoto) -> RoughPose:
    """Rough pose of a photo by the nearest solved one in the list."""
    other = nearest_posed(scene, photo)
    rotation, translation, _ = photos.read_pose(scene, other)
    return pose_like_neighbour(rotation, translation, scan_bounds(scene), other.name)


def nearest_posed(scene: bpy.types.Scene, photo: FrescoPhoto) -> FrescoPhoto:
    """Return the solved photo that stands nearest to another one in the list; RegionError without any."""
    all_photos = list(scene.fresco.photos)
    here = all_photos.index(photo)
    posed = [k for k, other in enumerate(all_photos) if other.is_posed and k != here]
    if not posed:
        raise RegionError("No other photo is solved yet.")
    return all_photos[min(posed, key=lambda k: abs(k - here))]
