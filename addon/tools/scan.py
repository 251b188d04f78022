"""Marking regions on the scan in the 3D view."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import bpy
import numpy as np
from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d

from ...core.arrays import BoolArray, Float32Array, FloatArray, IndexArray
from ...core.errors import RegionError
from ...core.jobs import Job
from ...core.regions.photo.outline import combined, polygon_mask
from ...core.regions.surface.wand import SurfaceClick, SurfaceLevel, grow_surface, region_faces
from ..background import Preparation, beside_job, one_step_job
from ..bridge import regions as bridge
from ..bridge.meshes import element_count
from ..bridge.regions import region_of
from ..overlays.lines import circle, draw_loops
from ..overlays.scan import draw_elements
from . import targets
from .levels import WandLevels
from .modal import BrushStroke, MarkingOperator, WandStroke
from .photo import PREVIEW
from .prepared import PreparedScan, face_mask, scan_job
from .views import ViewGeometry, dense_path


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

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> bool:
        return self.released

    def draw_stroke(self) -> None:
        draw_loops([np.array(self.path, dtype=np.float64)], PREVIEW, closed=False)

    def apply(self, context: bpy.types.Context, result: BoolArray) -> None:
        targets.mark_scan(context, result, self.mode)

    def rays(self, places: Sequence[tuple[float, float]]) -> tuple[FloatArray, FloatArray]:
        """Origins (n,3), metres, and directions (n,3) of the rays through places of the region."""
        origins = [region_2d_to_origin_3d(self._region, self.view, place) for place in places]
        towards = [region_2d_to_vector_3d(self._region, self.view, place) for place in places]
        return np.array(origins, dtype=np.float64), np.array(towards, dtype=np.float64)


class FRESCO_OT_scan_wand(ScanStroke, WandStroke, bpy.types.Operator):
    bl_idname = "fresco.scan_wand"
    bl_label = "Surface Wand"
    bl_description = (
        "Click a smooth part of the scan; drag right or left, or press plus or minus, for a larger or "
        "smaller region. Shift adds, Ctrl takes away"
    )
    step_width = 24

    def job(self, context: bpy.types.Context) -> Job[GrownSurface]:
        return self._click_job(context.scene.fresco.scan, self.rays([self.pressed]))

    def _click_job(self, scan: bpy.types.Object, ray: tuple[FloatArray, FloatArray]) -> Job[GrownSurface]:
        self.scan = prepared = yield from scan_job(scan)
        return (
            yield from beside_job(one_step_job(lambda: clicked_surface(prepared, ray), "Finding the region"))
        )

    def begin(self, context: bpy.types.Context, prepared: GrownSurface) -> None:
        WandStroke.begin(self, context, prepared.found)
        self.shown = prepared
        self._choosing: Preparation[GrownSurface] | None = None

    def handle(self, context: bpy.types.Context, event: bpy.types.Event) -> bool:
        """Choose a level in a thread; the one before is shown until its faces are known."""
        released = WandStroke.handle(self, context, event)
        level = self.found.level(self.steps)
        if self._choosing is not None and self._choosing.done:
            self.shown, self._choosing = self._choosing.result(), None
        if self._choosing is None and self.shown.level is not level:
            job = one_step_job(partial(grown_surface, self.scan, self.found, level), "Finding the region")
            self._choosing = Preparation((), job)
        return released and self._choosing is None

    def draw_stroke(self) -> None:
        draw_elements(self.scan.primitive, self.shown.corners, PREVIEW, self.view.perspective_matrix)

    def work(self, context: bpy.types.Context) -> Callable[[], BoolArray]:
        faces, count = self.shown.faces, self.scan.count
        return lambda: face_mask(faces, count)

    def apply(self, context: bpy.types.Context, result: BoolArray) -> None:
        chosen = context.scene.fresco.active_region
        earlier = None if chosen is None else bridge.read_faces(context.scene, chosen)
        region = targets.mark_scan(context, result, self.mode)
        click = ScanClick(self.scan, self.found, region.uid, self.mode, earlier)
        self.keep_click(context, click)


@dataclass(frozen=True, eq=False)
class GrownSurface:
    """A level of a click on the scan: its faces or points (n,), and their corners (k,3) m to be drawn."""

    found: SurfaceClick
    level: SurfaceLevel
    faces: IndexArray
    corners: Float32Array


def clicked_surface(scan: PreparedScan, ray: tuple[FloatArray, FloatArray]) -> GrownSurface:
    """Best region around the face or point that a ray (1,3) m, (1,3) meets first."""
    hit = scan.first_hit(*ray)[0]
    if hit[0] < 0:
        raise RegionError("The click is not on the scan: click a place where it shows a surface.")
    found = grow_surface(scan.index, int(hit[0]))
    return grown_surface(scan, found, found.level())


def grown_surface(scan: PreparedScan, found: SurfaceClick, level: SurfaceLevel) -> GrownSurface:
    """Faces or points of a level of a click."""
    faces = region_faces(scan.index, found.face, level)
    return GrownSurface(found, level, faces, scan.corners(faces))


class ScanClick(WandLevels[IndexArray]):
    """A click of the wand on the scan; what a level marks is kept as numbers of faces or points (n,)."""

    def __init__(
        self, scan: PreparedScan, found: SurfaceClick, uid: int, mode: str, earlier: BoolArray | None
    ) -> None:
        super().__init__(found, uid)
        self.scan, self.mode, self.earlier = scan, mode, earlier

    def mark(self, level: SurfaceLevel) -> IndexArray:
        return region_faces(self.scan.index, self.found.face, level)

    def write(self, context: bpy.types.Context, mark: IndexArray) -> bool:
        region, scan = region_of(context.scene, self.uid), context.scene.fresco.scan
        if region is None or scan is None or element_count(scan.data) != self.scan.count:
            return False
        stroke = face_mask(mark, self.scan.count)
        bridge.write_faces(context.scene, region, combined(self.earlier, stroke, self.mode))
        return True


class FRESCO_OT_scan_brush(BrushStroke, ScanStroke, bpy.types.Operator):
    bl_idname = "fresco.scan_brush"
    bl_label = "Surface Brush"
    bl_description = "Paint a region on the scan. Adds to the chosen one; Ctrl takes away"
    hint = "Paint the region   Ctrl: take away"

    def draw_stroke(self) -> None:
        super().draw_stroke()
        centre = np.array(self.path[-1], dtype=np.float64)
        draw_loops([circle(centre, bpy.context.scene.fresco_marking.radius)], PREVIEW)

    def work(self, context: bpy.types.Context) -> Callable[[], BoolArray]:
        radius = context.scene.fresco_marking.radius
        places = dense_path(self.path, max(2.0, 0.3 * radius))
        origins, towards = self.rays(places)
        beside = self.rays([(x + radius, y) for x, y in places])
        scan, view = self.scan, ViewGeometry(self.view)
        return lambda: brushed_faces(scan, view, (origins, towards), beside)


class FRESCO_OT_scan_lasso(ScanStroke, bpy.types.Operator):
    bl_idname = "fresco.scan_lasso"
    bl_label = "Surface Lasso"
    bl_description = (
        "Draw around a region of the scan; what is hidden is left out. Shift adds, Ctrl takes away"
    )
    hint = "Draw around the region   Shift: add   Ctrl: take away"

    def draw_stroke(self) -> None:
        draw_loops([np.array(self.path, dtype=np.float64)], PREVIEW, closed=len(self.path) > 2)

    def work(self, context: bpy.types.Context) -> Callable[[], BoolArray]:
        scan, view = self.scan, ViewGeometry(self.view)
        mask = polygon_mask([np.array(self.path)], self._region.width, self._region.height)
        return lambda: enclosed_faces(scan, view, mask)


def brushed_faces(
    scan: PreparedScan,
    view: ViewGeometry,
    rays: tuple[FloatArray, FloatArray],
    beside: tuple[FloatArray, FloatArray],
) -> BoolArray:
    """Faces or points (F,) under a brush: rays (n,3), (n,3) through the stroke, and one radius beside."""
    element, distance = scan.first_hit(*rays)
    struck = np.flatnonzero(element >= 0)
    if len(struck) == 0:
        raise RegionError("The stroke is not on the scan: paint where it shows a surface.")
    points = rays[0][struck] + distance[struck, None] * rays[1][struck]
    origins, towards = beside[0][struck], beside[1][struck]
    along = np.sum((points - origins) * towards, axis=1)
    radius = np.linalg.norm(origins + along[:, None] * towards - points, axis=1)
    middle = scan.index.middle.astype(np.float64) + scan.index.centre
    inside = np.zeros(len(middle), dtype=np.bool_)
    for point, size in zip(points, radius, strict=True):
        inside |= np.sum((middle - point) ** 2, axis=1) < size * size
    inside = scan.facing(view, inside)
    inside[element[struck]] = True  # however small the brush
    return inside


def enclosed_faces(scan: PreparedScan, view: ViewGeometry, mask: BoolArray) -> BoolArray:
    """Faces or points (F,) that are seen inside a mask (H,W) of the region, whose first row is the lowest."""
    height, width = mask.shape
    middle = scan.index.middle.astype(np.float64) + scan.index.centre
    places, before = view.on_screen(middle, width, height)
    before &= np.all((places >= 0) & (places < [width, height]), axis=1)
    cells = places[before].astype(np.int64)
    chosen = np.flatnonzero(before)[mask[cells[:, 1], cells[:, 0]]]
    seen = chosen[scan.visible(view, chosen)]
    if len(seen) == 0:
        raise RegionError("The outline holds nothing of the scan: draw it where the scan shows a surface.")
    return face_mask(seen, len(middle))


CLASSES = (FRESCO_OT_scan_wand, FRESCO_OT_scan_brush, FRESCO_OT_scan_lasso)
