"""A scan of points in the 3D view: Blender draws points of a mesh without their colours, so Fresco does."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ...core.arrays import Float32Array
from ...core.texture.views.cloud import point_spacing
from ..bridge import meshes
from ..bridge.clouds import shown_colours
from ..bridge.world import matrix_to_array
from ..tools.cloud import PreparedCloud
from ..tools.prepared import STORE
from .kept import Kept

_MOST = 4_000_000  # points that are drawn; of more, every so many-th one
_SIZE = 1.6, 2.0, 14.0  # size of a point: spacings, and pixels at least and at most
_DARK, _BRIGHT = 0.2, 0.9
_LIGHT = np.array([0.35, -0.5, 0.79])
_GREY = 0.6


class DrawnCloud:
    """What is drawn of a cloud: points (n,3), m, in its own frame, colours (n,4), and their usual spacing."""

    def __init__(self, points: Float32Array, colours: Float32Array) -> None:
        self.points, self.colours = points, colours
        self.spacing = point_spacing(points)

    @cached_property
    def batch(self) -> gpu.types.GPUBatch:
        """The points on the graphics card; threads cannot put them there."""
        shader = gpu.shader.from_builtin("FLAT_COLOR")
        return batch_for_shader(shader, "POINTS", {"pos": self.points, "color": self.colours})


class Clouds(Kept[DrawnCloud]):
    """Drawn clouds, made anew beside the window when the points or their colours change."""

    changes = 0  # of the scan, as Blender tells them

    def of_scan(self, scan: bpy.types.Object, layer: str) -> DrawnCloud | None:
        """Return what is drawn of a scan; None while it is made for the first time."""
        normals = _known_normals(scan)
        key = (scan.data.session_uid, len(scan.data.vertices), layer, self.changes, normals is None)
        return self.of("cloud", key, True, lambda: _gathered(scan, normals))


CLOUDS = Clouds()


def _known_normals(scan: bpy.types.Object) -> Float32Array | None:
    """Unit normals (V,3) of a cloud that is prepared for clicks."""
    work = STORE.scan
    if work is None or not work.done or work.failed:
        return None
    prepared = work.result()
    fits = isinstance(prepared, PreparedCloud) and prepared.count == len(scan.data.vertices)
    return prepared.index.normal if fits else None


def _gathered(scan: bpy.types.Object, normals: Float32Array | None) -> Callable[[], DrawnCloud]:
    """Take points and colours out of Blender; -> the function that makes what is drawn."""
    points = meshes.read_positions(scan.data)
    every = max(1, -(-len(points) // _MOST))
    known, intensity = shown_colours(scan.data)

    def make() -> DrawnCloud:
        colours = np.ones((len(points), 4), dtype=np.float32)
        if known is not None:
            colours[:, :3] = known / np.float32(255)
        elif intensity is not None:
            low, high = np.percentile(intensity, (2, 98))
            grey = np.clip((intensity - low) / max(high - low, 1e-9), 0, 1)
            colours[:, :3] = (_DARK + (_BRIGHT - _DARK) * grey)[:, None]
        elif normals is not None:
            colours[:, :3] = (_DARK + (_BRIGHT - _DARK) * np.abs(normals @ _LIGHT))[:, None]
        else:
            colours[:, :3] = _GREY
        return DrawnCloud(points[::every], colours[::every])

    return make


def draw() -> None:
    """Draw the scan's points in their colours."""
    context = bpy.context
    scan = context.scene.fresco.scan
    if scan is None or not meshes.is_cloud(scan.data) or scan.mode == "EDIT" or not scan.visible_get():
        return
    drawn = CLOUDS.of_scan(scan, context.scene.fresco.layer)
    if drawn is None:
        return
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    gpu.state.point_size_set(_point_size(context, drawn.spacing))
    with gpu.matrix.push_pop():
        gpu.matrix.multiply_matrix(scan.matrix_world)
        drawn.batch.draw(gpu.shader.from_builtin("FLAT_COLOR"))
    gpu.state.point_size_set(1.0)
    gpu.state.depth_mask_set(False)
    gpu.state.depth_test_set("NONE")


def _point_size(context: bpy.types.Context, spacing: float) -> float:
    """Pixels across a point, so that points of a surface before the view touch each other."""
    view = context.region_data
    scale = 0.5 * context.region.width * matrix_to_array(view.window_matrix)[0, 0]
    if view.is_perspective:
        scale /= max(view.view_distance, 1e-6)
    share, least, most = _SIZE
    return float(np.clip(share * spacing * scale, least, most))
