"""A point falls on the same pixel through core's camera and through Blender's."""

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mathutils import Vector

FUNCTION_FIXTURE = settings(deadline=None, max_examples=40, suppress_health_check=list(HealthCheck))


@pytest.fixture
def bridge(module):
    return module("addon.bridge.cameras")


def new_camera(scene):
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    return camera


def blender_pixels(scene, camera, points):
    """Pixels (N,2), core's convention, at which Blender's camera shows points (N,3) of Blender's world."""
    bpy.context.view_layer.update()
    views = np.array([world_to_camera_view(scene, camera, Vector(p)) for p in points])
    width, height = scene.render.resolution_x, scene.render.resolution_y
    return np.stack([views[:, 0] * width - 0.5, (1 - views[:, 1]) * height - 0.5], axis=1)


@given(
    size=st.tuples(st.integers(200, 9000), st.integers(200, 9000)),
    focal=st.floats(0.4, 6.0),
    ratio=st.floats(0.6, 1.7),
    off=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)),
    seed=st.integers(0, 1000),
)
@FUNCTION_FIXTURE
def test_points_fall_on_the_same_pixel(extension, module, bridge, size, focal, ratio, off, seed):
    scene = bpy.context.scene
    width, height = size
    fx = focal * max(size)
    K = np.array([[fx, 0, width * (0.5 + off[0])], [0, fx * ratio, height * (0.5 + off[1])], [0, 0, 1]])
    rng = np.random.default_rng(seed)
    rotation = module("core.geometry.rigid").exp_so3(rng.normal(size=3))
    centre = rng.normal(size=3)
    translation = -rotation @ centre
    core = module("core.cameras").PerspectiveCamera(width, height, K)

    camera = new_camera(scene)
    bridge.write_calibration(camera.data, core)
    bridge.apply_frame(scene, bridge.frame_of(core))
    bridge.write_pose(camera, rotation, translation)

    rays = core.unproject(rng.random((30, 2)) * size)
    points = (rays * rng.uniform(2, 9, (30, 1)) - translation) @ rotation
    expected = core.project(points @ rotation.T + translation)
    np.testing.assert_allclose(blender_pixels(scene, camera, points), expected, atol=2e-5 * max(size))

    read_rotation, read_translation = bridge.read_pose(camera)
    np.testing.assert_allclose(read_rotation, rotation, atol=5e-6)  # Blender keeps single precision
    np.testing.assert_allclose(read_translation, translation, atol=5e-6)
    bpy.data.objects.remove(camera)
