"""Marking regions on the scan in the 3D view."""

from __future__ import annotations

import bpy
import numpy as np
from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d

from ...core.arrays import BoolArray, FloatArray, IndexArray
from ...core.errors import RegionError
from ...core.jobs import Job
from ...core.regions.outline import polygon_mask
from ...core.regions.surface_wand import grow_surface, region_faces
from ..bridge.world import matrix_to_array
from ..overlays.lines import circle, draw_loops
from ..overlays.scan import draw_faces, lifted
from . import targets
from .modal import MarkingOperator
from .photo import PREVIEW, strokes
from .prepared import PreparedScan, scan_job

_STEP = 24  # screen pixels of dragging per tolerance of the wand


class ScanStroke(MarkingOperator):
    """Mixin: a stroke in the 3D view."""

    space = bpy.types.SpaceView3D

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        scan = context.scene.fresco.scan
        cls.poll_message_set("Import a scan first (step 1), and leave Edit Mode")
        return scan is not None and scan.name in context.scene.objects and scan.mode == "OBJECT"

    def job(self, context: bpy.types.Context) -> Job[PreparedScan]:
        return scan_job(context.scene.fresco.scan)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.mode = targets.stroke_mode(event)
        self.view = context.region_data
        return super().invoke(context, event)

    def begin(self, context: bpy.types.Context, prepared: PreparedScan) -> None:
        self.scan = prepared

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> bool | None:
        return True if self.is_release(event) else None

    def draw_stroke(self) -> None:
        draw_loops([np.array(self.path, dtype=np.float64)], PREVIEW, closed=False)

    def hits(self, places: list[tuple[float, float]]) -> tuple[IndexArray, FloatArray]:
        """Faces (n,) and points (n,3), metres, under places of the region.

        Places beside the scan are left out.
        """
        origins = np.array(
            [region_2d_to_origin_3d(self._region, self.view, p) for p in places], dtype=np.float64
        )
        towards = np.array(
            [region_2d_to_vector_3d(self._region, self.view, p) for p in places], dtype=np.float64
        )
        hit = self.scan.caster.first_hit(origins, towards)
        struck = hit.face >= 0
        points = origins[struck] + hit.distance[struck, None].astype(np.float64) * towards[struck]
        return hit.face[struck].astype(np.int64), points


class FRESCO_OT_scan_wand(ScanStroke, bpy.types.Operator):
    bl_idname = "fresco.scan_wand"
    bl_label = "Surface Wand"
    bl_description = (
        "Click a smooth part of the scan; drag for a smaller or larger region. Shift adds, Ctrl takes away"
    )

    def begin(self, context: bpy.types.Context, prepared: PreparedScan) -> None:
        super().begin(context, prepared)
        faces, _ = self.hits([self.pressed])
        if len(faces) == 0:
            raise RegionError("The click is not on the scan.")
        self.face = int(faces[0])
        self.found = grow_surface(prepared.index, self.face)
        self._choose(0)

    def _choose(self, steps: int) -> None:
        level = self.found.level(steps)
        self.faces = region_faces(self.scan.index, self.face, level)
        self.level = level
        self.corners = lifted(self.scan.vertices, self.scan.faces[self.faces])

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> bool | None:
        if event.type == "MOUSEMOVE" and not self.released:
            steps = round((event.mouse_region_x - self.pressed[0]) / _STEP)
            if self.found.level(steps) is not self.level:
                self._choose(steps)
        return True if self.is_release(event) else None

    def draw_stroke(self) -> None:
        draw_faces(self.corners, PREVIEW, self.view.perspective_matrix)

    def apply(self, context: bpy.types.Context) -> None:
        targets.mark_scan(context, self.faces, self.mode)


class FRESCO_OT_scan_brush(ScanStroke, bpy.types.Operator):
    bl_idname = "fresco.scan_brush"
    bl_label = "Surface Brush"
    bl_description = "Paint a region on the scan. Adds to the chosen one; Ctrl takes away"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        started = super().invoke(context, event)
        self.mode = "subtract" if event.ctrl else "add"
        return started

    def draw_stroke(self) -> None:
        super().draw_stroke()
        centre = np.array(self.path[-1], dtype=np.float64)
        draw_loops([circle(centre, bpy.context.scene.fresco_marking.radius)], PREVIEW)

    def apply(self, context: bpy.types.Context) -> None:
        radius = context.scene.fresco_marking.radius
        aside = [(x + radius, y) for x, y in self.path]
        _, centres = self.hits(self.path)
        if len(centres) == 0:
            raise RegionError("The stroke is not on the scan.")
        middle = self.scan.index.middle.astype(np.float64) + self.scan.index.centre
        inside = np.zeros(len(middle), dtype=np.bool_)
        for place, beside in zip(self.path, aside, strict=True):
            _, hit = self.hits([place])
            if len(hit):
                size = self._world_radius(place, beside, hit[0])
                inside |= np.sum((middle - hit[0]) ** 2, axis=1) < size * size
        facing = facing_view(self.view, middle, self.scan.index.normal)
        targets.mark_scan(context, np.flatnonzero(inside & facing), self.mode)

    def _world_radius(
        self, place: tuple[float, float], beside: tuple[float, float], point: FloatArray
    ) -> float:
        """Metres that the brush's radius covers at a point of the scan."""
        origin = np.array(region_2d_to_origin_3d(self._region, self.view, beside), dtype=np.float64)
        towards = np.array(region_2d_to_vector_3d(self._region, self.view, beside), dtype=np.float64)
        along = (point - origin) @ towards
        return float(np.linalg.norm(origin + along * towards - point))


class FRESCO_OT_scan_lasso(ScanStroke, bpy.types.Operator):
    bl_idname = "fresco.scan_lasso"
    bl_label = "Surface Lasso"
    bl_description = (
        "Draw around a region of the scan; what is hidden is left out. Shift adds, Ctrl takes away"
    )

    def draw_stroke(self) -> None:
        draw_loops([np.array(self.path, dtype=np.float64)], PREVIEW, closed=len(self.path) > 2)

    def apply(self, context: bpy.types.Context) -> None:
        region = self._region
        middle = self.scan.index.middle.astype(np.float64) + self.scan.index.centre
        places, before = on_screen(self.view, middle, region.width, region.height)
        mask = polygon_mask([np.array(self.path)], region.width, region.height)
        before &= np.all((places >= 0) & (places < [region.width, region.height]), axis=1)
        before &= facing_view(self.view, middle, self.scan.index.normal)
        cells = places[before].astype(np.int64)
        faces = np.flatnonzero(before)[mask[cells[:, 1], cells[:, 0]]]
        seen = ~self.scan.caster.occluded(view_origins(self.view, middle[faces]), middle[faces])
        if not seen.any():
            raise RegionError("The outline holds no face of the scan.")
        targets.mark_scan(context, faces[seen], self.mode)


def on_screen(
    view: bpy.types.RegionView3D, points: FloatArray, width: int, height: int
) -> tuple[FloatArray, BoolArray]:
    """Places (N,2) in a region of points (N,3), metres, and whether (N,) they lie before the view."""
    matrix = matrix_to_array(view.perspective_matrix)
    clip = points @ matrix[:, :3].T + matrix[:, 3]
    before = clip[:, 3] > 1e-9
    flat = clip[:, :2] / np.where(before, clip[:, 3], 1.0)[:, None]
    return (flat + 1) / 2 * np.array([width, height]), before


def view_origins(view: bpy.types.RegionView3D, points: FloatArray) -> FloatArray:
    """Where the rays to points (N,3) come from.

    The eye (3,), or far before each point (N,3) in parallel views.
    """
    camera = np.linalg.inv(matrix_to_array(view.view_matrix))
    if view.is_perspective:
        return camera[:3, 3]
    return points + camera[:3, 2] * (
        2.0 * float(np.ptp(points, axis=0).max(initial=1.0)) + view.view_distance
    )


def facing_view(view: bpy.types.RegionView3D, points: FloatArray, normals: FloatArray) -> BoolArray:
    """Which faces (N,) look towards the view: their middles (N,3), metres, and unit normals (N,3)."""
    return np.sum((view_origins(view, points) - points) * normals, axis=1) > 0


class ScanTool(bpy.types.WorkSpaceTool):
    """Base of the 3D view's tools."""

    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"


class FRESCO_TOOL_scan_wand(ScanTool):
    bl_idname = "fresco.tool_scan_wand"
    bl_label = "Surface Wand"
    bl_description = "One click marks a smooth part of the scan; drag for a smaller or larger one"
    bl_icon = "ops.paint.weight_fill"
    bl_keymap = strokes("fresco.scan_wand")
    bl_cursor = "EYEDROPPER"

    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: object) -> None:
        draw_target(context, layout)


class FRESCO_TOOL_scan_brush(ScanTool):
    bl_idname = "fresco.tool_scan_brush"
    bl_label = "Surface Brush"
    bl_description = "Paint a region on the scan, or take away from it with Ctrl"
    bl_icon = "ops.generic.select_circle"
    bl_keymap = strokes("fresco.scan_brush")
    bl_cursor = "PAINT_BRUSH"

    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: object) -> None:
        layout.prop(context.scene.fresco_marking, "radius")
        draw_target(context, layout)


class FRESCO_TOOL_scan_lasso(ScanTool):
    bl_idname = "fresco.tool_scan_lasso"
    bl_label = "Surface Lasso"
    bl_description = "Draw around a region of the scan"
    bl_icon = "ops.generic.select_lasso"
    bl_keymap = strokes("fresco.scan_lasso")
    bl_cursor = "CROSSHAIR"

    def draw_settings(context: bpy.types.Context, layout: bpy.types.UILayout, _tool: object) -> None:
        draw_target(context, layout)


def draw_target(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
    """Say which region the next stroke marks."""
    region = context.scene.fresco.active_region
    new = region is None or region.face_count > 0
    layout.label(text="Marks a new region" if new else f"Marks {region.name}", icon="FACESEL")


CLASSES = (FRESCO_OT_scan_wand, FRESCO_OT_scan_brush, FRESCO_OT_scan_lasso)
TOOLS = (FRESCO_TOOL_scan_wand, FRESCO_TOOL_scan_brush, FRESCO_TOOL_scan_lasso)
