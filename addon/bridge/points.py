"""Surveyed points of the scene and their pixels in photos, between Blender and core."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Vector

from ...core.arrays import ArrayLike, FloatArray
from ...core.pose.points.survey import Survey
from ...core.project import PhotoPose
from ..properties import FrescoPhoto
from .meshes import is_cloud, read_vertices
from .photos import read_camera, read_pose

_EXACT = 0.003  # radians, some pixels of a view


def write_point(scene: bpy.types.Scene, name: str, point: ArrayLike) -> None:
    """Add a point (3,) in Blender's world, metres, or move the one of that name, and choose it."""
    points = scene.fresco.points
    item = points.get(name)
    if item is None:
        item = points.add()
        item.name = name
    item.place = np.asarray(point, dtype=np.float64).tolist()
    scene.fresco.point_index = points.find(name)


def next_name(scene: bpy.types.Scene) -> str:
    """Return a name that no point has."""
    number = 1
    while scene.fresco.points.get(f"P{number}") is not None:
        number += 1
    return f"P{number}"


def remove_point(scene: bpy.types.Scene, index: int) -> None:
    """Take a point out of the list and out of all photos."""
    fresco = scene.fresco
    name = fresco.points[index].name
    for photo in fresco.photos:
        place = photo.picks.find(name)
        if place >= 0:
            photo.picks.remove(place)
    fresco.points.remove(index)
    fresco.point_index = max(0, min(index, len(fresco.points) - 1))


def read_points(scene: bpy.types.Scene) -> Survey:
    """Return all points, in Blender's world, which is the scan's local frame."""
    points = scene.fresco.points
    places = np.array([tuple(point.place) for point in points], dtype=np.float64).reshape(-1, 3)
    return Survey(tuple(point.name for point in points), places)


def write_pick(photo: FrescoPhoto, name: str, pixel: ArrayLike) -> None:
    """Set the pixel (2,) at which a photo shows a point."""
    item = photo.picks.get(name)
    if item is None:
        item = photo.picks.add()
        item.name = name
    item.pixel = np.asarray(pixel, dtype=np.float64).tolist()
    item.residual, item.active = -1.0, True


def read_picks(photo: FrescoPhoto) -> dict[str, tuple[float, float]]:
    """Return the pixels of the active points of a photo."""
    return {pick.name: (pick.pixel[0], pick.pixel[1]) for pick in photo.picks if pick.active}


def write_residuals(photo: FrescoPhoto, result: PhotoPose) -> None:
    """Keep how far each point lies off in its photo, and which ones hold the pose."""
    for point in result.points:
        item = photo.picks.get(point.name)
        if item is not None:
            item.offset = point.residual
            item.residual, item.used = float(np.hypot(*point.residual)), point.used


def write_check_residuals(scene: bpy.types.Scene, photo: FrescoPhoto) -> None:
    """Keep how far the points whose tick is off lie from where the photo's pose puts them."""
    rotation, translation, _ = read_pose(scene, photo)
    camera, points = read_camera(photo), scene.fresco.points
    for pick in photo.picks:
        point = points.get(pick.name)
        if pick.active or point is None:
            continue
        projected = camera.project(np.array([point.place[:]]) @ rotation.T + translation)[0]
        offset = np.array(pick.pixel[:]) - projected
        seen = bool(np.all(np.isfinite(offset)))
        pick.offset = offset if seen else (0.0, 0.0)
        pick.residual, pick.used = float(np.hypot(*offset)) if seen else -1.0, False


def point_on_scan(context: bpy.types.Context, origin: Vector, direction: Vector) -> FloatArray | None:
    """Place (3,) in Blender's world where a ray meets the scan, None where it passes by."""
    scan = context.scene.fresco.scan
    if is_cloud(scan.data):
        return _point_beside(read_vertices(scan), np.array(origin), np.array(direction.normalized()))
    inverse = scan.matrix_world.inverted()
    start, way = inverse @ origin, (inverse.to_3x3() @ direction).normalized()
    hit, place, _, _ = scan.ray_cast(start, way, depsgraph=context.evaluated_depsgraph_get())
    return np.array(scan.matrix_world @ place) if hit else None


def _point_beside(points: FloatArray, origin: FloatArray, direction: FloatArray) -> FloatArray | None:
    """Nearest of the points (N,3) that lie beside a ray by less than a click is exact, m."""
    away = points - origin
    along = away @ direction
    beside = np.linalg.norm(away - along[:, None] * direction, axis=1)
    met = np.flatnonzero((along > 0) & (beside < _EXACT * along))
    return points[met[np.argmin(along[met])]] if len(met) else None
