"""Cameras between core and Blender.

Core: x right, y down, z forward; pixels with the centre of the top-left one at (0, 0). Blender: x right,
y up, looking along -z; the principal point is a shift in units of the frame's width, from the frame's middle.
Blender's camera has no lens distortion: it is the photo's pinhole camera (same K), and its background is the
photo without distortion. The full calibration stays with the photo (`properties.FrescoPhoto.camera_json`).
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix

from ...core.arrays import FloatArray
from ...core.cameras import Camera
from .world import matrix_to_array

SENSOR_WIDTH = 36.0  # mm; lens values then read as 35 mm equivalents
_FLIP = np.diag([1.0, -1.0, -1.0])  # core's camera axes <-> Blender's


@dataclass(frozen=True)
class Frame:
    """What looking through a photo needs of the scene's render settings."""

    width: int
    height: int
    pixel_aspect_x: float
    pixel_aspect_y: float


def pinhole_matrix(camera: Camera) -> FloatArray:
    """Return the `K` (3,3) of the pinhole camera that agrees with a camera around its optical axis."""
    (centre,), (slope,) = camera.project_with_jacobian([[0.0, 0.0, 1.0]])
    return np.array([[slope[0, 0], 0.0, centre[0]], [0.0, slope[1, 1], centre[1]], [0.0, 0.0, 1.0]])


def frame_of(camera: Camera) -> Frame:
    """Frame of a photo; its pixels need not be square."""
    K = pinhole_matrix(camera)
    ratio = float(K[0, 0] / K[1, 1])  # height of a pixel over its width
    return Frame(camera.width, camera.height, max(1.0, 1.0 / ratio), max(1.0, ratio))


def write_calibration(data: bpy.types.Camera, camera: Camera) -> None:
    """Set lens and shift of Blender's camera to those of the photo's camera without its distortion."""
    K, width, height = pinhole_matrix(camera), camera.width, camera.height
    ratio = float(K[0, 0] / K[1, 1])
    data.type = "PERSP"
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = SENSOR_WIDTH
    data.lens_unit = "MILLIMETERS"
    data.lens = float(K[0, 0]) * SENSOR_WIDTH / width
    data.shift_x = (0.5 * (width - 1) - float(K[0, 2])) / width
    data.shift_y = ratio * (float(K[1, 2]) - 0.5 * (height - 1)) / width


def apply_frame(scene: bpy.types.Scene, frame: Frame) -> None:
    """Give the scene's render settings the photo's size and pixel shape."""
    render = scene.render
    render.resolution_x, render.resolution_y = frame.width, frame.height
    render.resolution_percentage = 100
    render.pixel_aspect_x, render.pixel_aspect_y = frame.pixel_aspect_x, frame.pixel_aspect_y


def pose_matrix(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Return the world matrix (4,4) of a camera object at a pose in Blender's world: (3,3), (3,) metres."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation.T @ _FLIP
    matrix[:3, 3] = -rotation.T @ translation
    return matrix


def write_pose(camera: bpy.types.Object, rotation: FloatArray, translation: FloatArray) -> None:
    """Put a camera object at a pose, world -> camera, in Blender's world: (3,3), (3,) metres."""
    camera.matrix_world = Matrix(pose_matrix(rotation, translation).tolist())


def read_pose(camera: bpy.types.Object) -> tuple[FloatArray, FloatArray]:
    """Pose of a camera object, world -> camera, in Blender's world: (3,3), (3,) metres."""
    matrix = matrix_to_array(camera.matrix_world)
    u, _, vt = np.linalg.svd(matrix[:3, :3])  # a scaled object is no scaled camera
    rotation = _FLIP @ (u @ vt).T
    return rotation, -rotation @ matrix[:3, 3]


def show_background(data: bpy.types.Camera, image: bpy.types.Image) -> None:
    """Make an image the camera's only background, filling its frame."""
    data.background_images.clear()
    background = data.background_images.new()
    background.image = image
    background.frame_method = "STRETCH"  # the frame has the photo's shape, pixel aspect included
    background.display_depth = "BACK"
    background.alpha = 1.0
    data.show_background_images = True
