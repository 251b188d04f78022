"""Over the scan in the 3D view: regions and proposals as tinted faces with outlines and names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Protocol

import bpy
import gpu
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix, Vector

from ...core.arrays import Float32Array, FloatArray, IndexArray
from ...core.errors import RegionError
from ...core.geometry.boundary import boundary_loops
from ..bridge import meshes
from ..bridge.regions import opening_in_world, patch
from ..bridge.world import matrix_to_array
from .kept import Kept
from .lines import WIDTH, Labels

_ALPHA, _PROPOSED_ALPHA = 0.4, 0.2
_POINT = 4.0  # pixels
_NEARER = 4e-6  # of the depth buffer's range (some 30 steps of it) by which overlays lie before the scan
PROPOSED = (1.0, 1.0, 1.0)
_LARGE = 100_000  # faces of a scan from which shapes are made beside the window


class Marked(Protocol):
    """A region or a proposal: faces as an attribute of the scan, or an opening."""

    attribute: str
    opening_json: str
    uid: int


class Shape:
    """What is drawn of a region: corners (3n,3) of faces, ends (2m,3) of its border's edges.

    In the scan object's own frame, m; but `loops` (k,3) and `middle` (3,), which are in Blender's world.
    """

    def __init__(self, corners: FloatArray, faces: IndexArray, matrix: FloatArray) -> None:
        self.corners = corners[faces].reshape(-1, 3).astype(np.float32)
        loops = [corners[loop] for loop in boundary_loops(faces)]
        self.edges = np.concatenate([_edges(loop) for loop in loops]) if loops else np.zeros((0, 3))
        self.loops = tuple(loop @ matrix[:3, :3].T + matrix[:3, 3] for loop in loops)
        self.middle = self.corners.mean(axis=0, dtype=np.float64) @ matrix[:3, :3].T + matrix[:3, 3]

    @cached_property
    def batches(self) -> tuple[gpu.types.GPUBatch, gpu.types.GPUBatch]:
        """Faces and edges on the graphics card; threads cannot put them there."""
        flat, line = (gpu.shader.from_builtin(name) for name in ("UNIFORM_COLOR", "POLYLINE_UNIFORM_COLOR"))
        return (
            batch_for_shader(flat, "TRIS", {"pos": self.corners}),
            batch_for_shader(line, "LINES", {"pos": self.edges.astype(np.float32)}),
        )


class Shapes(Kept["Shape | None"]):
    """Shapes of regions and proposals, made anew when their faces or the scan change."""

    def of_item(self, scan: bpy.types.Object, item: Marked) -> Shape | None:
        """Shape of a region or proposal; None where it is not on the scan, or while a large one is made."""
        mesh = scan.data
        place = matrix_to_array(scan.matrix_world).tobytes()
        revision = getattr(item, "revision", 0)
        key = (mesh.session_uid, len(mesh.vertices), len(mesh.polygons), place, revision, item.opening_json)
        large = meshes.is_cloud(mesh) or len(mesh.polygons) > _LARGE
        large = large and not item.opening_json
        return self.of(item.attribute, key, large, lambda: _gathered(scan, item))

    def loops(self, scene: bpy.types.Scene, item: Marked) -> tuple[FloatArray, ...]:
        """Outlines (n,3) of a region in Blender's world, metres."""
        scan = scene.fresco.scan
        if scan is None or not meshes.is_triangulated(scan.data):
            return ()
        shape = self.of_item(scan, item)
        return () if shape is None else shape.loops


SHAPES = Shapes()


def _gathered(scan: bpy.types.Object, item: Marked) -> Callable[[], Shape | None]:
    """Take a region's faces out of Blender; -> the function that makes its shape."""
    matrix = matrix_to_array(scan.matrix_world)
    if item.opening_json:
        world, triangles = opening_in_world(scan, item.opening_json)
        corners = meshes.to_object_frame(scan, world)
        return lambda: Shape(corners, triangles, matrix)
    inside = meshes.read_element_attribute(scan.data, item.attribute)
    if inside is None or not inside.any():
        return lambda: None
    faces, positions = meshes.read_any_faces(scan.data), meshes.read_positions(scan.data)

    def make() -> Shape | None:
        try:
            surface = patch(positions.astype(np.float64), faces, inside, "")
        except RegionError:  # points without an outline: the advice tells
            return None
        return Shape(surface.vertices, surface.faces, matrix)

    return make


def _edges(loop: FloatArray) -> FloatArray:
    """Ends (2n,3) of the sides of a closed loop (n,3)."""
    return np.stack([loop, np.roll(loop, -1, axis=0)], axis=1).reshape(-1, 3)


def draw_elements(primitive: str, corners: Float32Array, color: Sequence[float], matrix: object) -> None:
    """Tint triangles "TRIS", corners (3n,3), or "POINTS" (n,3), in Blender's world, where pixels are drawn.

    `matrix` is the view's.
    """
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    with gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
        gpu.matrix.load_identity()
        gpu.matrix.load_projection_matrix(matrix)
        shader.bind()
        shader.uniform_float("color", (*color[:3], _ALPHA))
        gpu.state.point_size_set(_POINT)
        batch_for_shader(shader, primitive, {"pos": corners}).draw(shader)
    gpu.state.blend_set("NONE")


def _shown_scan(scene: bpy.types.Scene) -> bpy.types.Object | None:
    scan = scene.fresco.scan
    if scan is None or scan.mode == "EDIT" or not scan.visible_get() or not meshes.is_triangulated(scan.data):
        return None
    return scan


def draw() -> None:
    """Tint the faces of all regions in their colours, and those of proposals."""
    scene = bpy.context.scene
    scan = _shown_scan(scene)
    if scan is None:
        return
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("LESS_EQUAL")
    with gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
        nearer = Matrix.Translation((0.0, 0.0, -_NEARER)) @ gpu.matrix.get_projection_matrix()
        gpu.matrix.load_projection_matrix(nearer)
        gpu.matrix.multiply_matrix(scan.matrix_world)
        for region in scene.fresco.regions:
            width = WIDTH + (1.5 if region == scene.fresco.active_region else 0.0)
            _draw_shape(SHAPES.of_item(scan, region), region.color, _ALPHA, width)
        marking = scene.fresco_marking
        for proposal in marking.proposals:
            chosen = proposal == marking.active_proposal
            alpha = _ALPHA if chosen else _PROPOSED_ALPHA
            _draw_shape(SHAPES.of_item(scan, proposal), PROPOSED, alpha, WIDTH + (1.5 if chosen else -0.5))
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


def _draw_shape(shape: Shape | None, color: Sequence[float], alpha: float, width: float) -> None:
    if shape is None:
        return
    flat, line = (gpu.shader.from_builtin(name) for name in ("UNIFORM_COLOR", "POLYLINE_UNIFORM_COLOR"))
    flat.bind()
    flat.uniform_float("color", (*color[:3], alpha))
    faces, edges = shape.batches
    faces.draw(flat)
    line.bind()
    line.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
    line.uniform_float("lineWidth", width)
    line.uniform_float("color", (*color[:3], 1.0))
    edges.draw(line)


def draw_names() -> None:
    """Write the names of regions and proposals on the scan."""
    context = bpy.context
    scan = _shown_scan(context.scene)
    if scan is None or not context.space_data.overlay.show_overlays:
        return
    labels = Labels()
    for region in context.scene.fresco.regions:
        _draw_name(SHAPES.of_item(scan, region), region.name, region.color, labels)
    for proposal in context.scene.fresco_marking.proposals:
        _draw_name(SHAPES.of_item(scan, proposal), f"{proposal.name}?", PROPOSED, labels)


def _draw_name(shape: Shape | None, name: str, color: Sequence[float], labels: Labels) -> None:
    if shape is None:
        return
    place = location_3d_to_region_2d(bpy.context.region, bpy.context.region_data, Vector(shape.middle))
    if place is not None:
        labels.draw(name, np.array(place), color)
