"""Faces of the marked regions over the scan in the 3D view."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ...core.arrays import AnyArray, BoolArray, Float32Array, IntArray
from ..bridge import meshes
from ..bridge import regions as bridge

_ALPHA = 0.45


class Batches:
    """What the graphics card draws per region, made anew when the region's faces or the scan change."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[object, gpu.types.GPUBatch]] = {}

    def of(self, scan: bpy.types.Object, attribute: str, inside: BoolArray) -> gpu.types.GPUBatch:
        """Triangles of the faces (F,) in the scan's own frame."""
        mesh = scan.data
        key = (mesh.name_full, mesh.session_uid, len(mesh.vertices), zlib.crc32(inside.tobytes()))
        known = self._known.get(attribute)
        if known is None or known[0] != key:
            corners = lifted(meshes.read_positions(mesh), meshes.read_faces(mesh)[inside])
            shader = gpu.shader.from_builtin("UNIFORM_COLOR")
            known = key, batch_for_shader(shader, "TRIS", {"pos": corners})
            self._known[attribute] = known
        return known[1]

    def clear(self) -> None:
        """Forget all: another file was opened."""
        self._known.clear()


def lifted(positions: AnyArray, faces: IntArray) -> Float32Array:
    """Corners (3n,3) of faces (n,3).

    A little in front of the scan so that both are not drawn into each other.
    """
    corners = positions[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    lift = 2e-4 * float(np.ptp(positions, axis=0).max())
    return (corners + lift * normal[:, None]).reshape(-1, 3).astype(np.float32)


BATCHES = Batches()


def draw_faces(corners: Float32Array, color: Sequence[float], matrix: object) -> None:
    """Tint triangles, corners (3n,3) in Blender's world, in a callback that draws pixels.

    `matrix` is the view's.
    """
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    with gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
        gpu.matrix.load_identity()
        gpu.matrix.load_projection_matrix(matrix)
        shader.bind()
        shader.uniform_float("color", (*color[:3], _ALPHA))
        batch_for_shader(shader, "TRIS", {"pos": corners}).draw(shader)
    gpu.state.blend_set("NONE")


def draw() -> None:
    """Tint the faces of all regions in their colours."""
    scene = bpy.context.scene
    scan = scene.fresco.scan
    if scan is None or scan.mode == "EDIT" or not scan.visible_get() or not meshes.is_triangulated(scan.data):
        return
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("LESS_EQUAL")
    with gpu.matrix.push_pop():
        gpu.matrix.multiply_matrix(scan.matrix_world)
        for region in scene.fresco.regions:
            inside = bridge.read_faces(scene, region)
            if inside.any():
                shader.bind()
                shader.uniform_float("color", (*region.color, _ALPHA))
                BATCHES.of(scan, region.attribute, inside).draw(shader)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")
