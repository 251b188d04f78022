"""Mend the chosen region: its outline in the shown photo, its faces on the scan."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ...core.arrays import BoolArray, ByteArray, FloatArray, IntArray
from ...core.errors import RegionError
from ...core.geometry.meshes import edge_pairs, face_normals
from ...core.jobs import Job, Progress
from ...core.photos import check_outline
from ...core.regions.photo.outline import (
    checked_selection,
    grown_mask,
    mask_polygons,
    polygon_mask,
    smoothed_mask,
    without_holes,
    without_specks,
)
from ...core.regions.photo.snap import snapped_mask_loops
from ...core.regions.surface import face_sets
from ..background import beside_job
from ..bridge import meshes
from ..bridge import regions as bridge
from ..bridge.images import read_mask_pixels
from ..jobs import JobOperator, StepOperator
from ..properties import FrescoPhoto
from ..tools import targets
from ..tools.prepared import read_pixels
from .regions import has_faces

MASK_ACTIONS = (
    ("SNAP", "Snap to Edges", "Move the outline onto the photo's edges", "SNAP_ON", 0),
    ("FILL", "Fill Holes", "Fill what the region encloses", "SNAP_FACE", 1),
    ("SMOOTH", "Smooth", "Take teeth and steps out of the outline", "SMOOTHCURVE", 2),
    ("SPECKS", "Remove Specks", "Keep the largest piece only", "PARTICLES", 3),
    ("GROW", "Grow", "Move the outline outwards by the distance in the panel", "FULLSCREEN_ENTER", 4),
    ("SHRINK", "Shrink", "Move the outline inwards by the distance in the panel", "FULLSCREEN_EXIT", 5),
    ("INVERT", "Invert", "Mark what is not marked, and the reverse", "IMAGE_ALPHA", 6),
)
FACE_ACTIONS = (
    ("FILL", "Fill Holes", "Add the faces that the region encloses", "SNAP_FACE", 1),
    ("SMOOTH", "Smooth", "Take teeth off the region's border", "SMOOTHCURVE", 2),
    ("SPECKS", "Remove Specks", "Keep the largest connected piece only", "PARTICLES", 3),
    ("GROW", "Grow", "Add the faces next to the region's border", "FULLSCREEN_ENTER", 4),
    ("SHRINK", "Shrink", "Take away the faces at the region's border", "FULLSCREEN_EXIT", 5),
    ("INVERT", "Invert", "Mark the faces that are not marked, and the reverse", "IMAGE_ALPHA", 6),
)


def shown_mark_photo(context: bpy.types.Context) -> FrescoPhoto | None:
    """Return the photo whose mark is mended: that in this Image Editor, else that chosen in the list."""
    photo = targets.shown_photo(context) or context.scene.fresco.active_photo
    region = context.scene.fresco.active_region
    marked = photo is not None and region is not None and photo.mark(region.uid) is not None
    return photo if marked else None


class MendingOperator(JobOperator):
    """Mixin: one of several `actions` on the chosen region, each with its own tooltip."""

    bl_options = {"REGISTER", "UNDO"}
    step = "regions"

    actions: tuple[tuple[str, str, str, str, int], ...] = ()

    @classmethod
    def description(cls, context: bpy.types.Context, properties: Any) -> str:
        return next(item[2] for item in cls.actions if item[0] == properties.action)


class FRESCO_OT_tidy_mark(MendingOperator):
    bl_idname = "fresco.tidy_mark"
    bl_label = "Mend Outline"
    bl_description = "Mend the chosen region's outline in the photo"
    actions = MASK_ACTIONS

    action: bpy.props.EnumProperty(name="Action", items=MASK_ACTIONS)

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        cls.poll_message_set("Choose a region that is marked in the shown photo")
        return shown_mark_photo(context) is not None

    def start(self, context: bpy.types.Context) -> Job[BoolArray]:
        photo, region = shown_mark_photo(context), context.scene.fresco.active_region
        self._photo, self._uid = photo.name, region.uid
        mask = read_mask_pixels(photo.mark(region.uid).image)
        marking = context.scene.fresco_marking
        distance = marking.reach if self.action == "SNAP" else marking.grow
        job = mended_job(mask, self.action, distance, photo.path, region.name)
        return beside_job(job)

    def finish(self, context: bpy.types.Context, result: BoolArray) -> None:
        photo, region = context.scene.fresco.photos[self._photo], bridge.region_of(context.scene, self._uid)
        targets.write_mask(photo, region, result)


def mended_job(mask: BoolArray, action: str, distance: float, path: str, name: str) -> Job[BoolArray]:
    """Mend a mask (H,W) of region `name` in the photo at `path`; `distance` in pixels of the photo."""
    yield Progress(0.1, "Mending the outline")
    pixels = read_pixels(path) if action == "SNAP" else None
    yield Progress(0.5, "Mending the outline")
    mended = mended_mask(mask, action, distance, pixels)
    if action == "INVERT":
        check_outline(mended, f"{name} inverted")
    return checked_selection(mended)


def mended_mask(mask: BoolArray, action: str, distance: float, pixels: ByteArray | None) -> BoolArray:
    """Mask (H,W) after an action; snapping needs the photo's pixels (H,W,3)."""
    if action == "SNAP":
        loops = snapped_mask_loops(pixels, mask_polygons(smoothed_mask(mask, 1.0)), distance)
        return polygon_mask(loops, *mask.shape[::-1])
    if action == "SMOOTH":
        return smoothed_mask(mask, 3.0)
    if action in {"GROW", "SHRINK"}:
        return grown_mask(mask, distance if action == "GROW" else -distance)
    return {"FILL": without_holes, "SPECKS": without_specks, "INVERT": np.logical_not}[action](mask)


class FRESCO_OT_tidy_faces(MendingOperator):
    bl_idname = "fresco.tidy_faces"
    bl_label = "Mend Faces"
    bl_description = "Mend the chosen region's faces on the scan"
    actions = FACE_ACTIONS

    action: bpy.props.EnumProperty(name="Action", items=FACE_ACTIONS)

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        fresco = context.scene.fresco
        if not has_faces(cls, context):
            return False
        cls.poll_message_set("Choose a region that has faces on the scan, and leave Edit Mode")
        region = fresco.active_region
        return fresco.scan.mode == "OBJECT" and region is not None and region.face_count > 0

    def start(self, context: bpy.types.Context) -> Job[BoolArray]:
        scan, region = context.scene.fresco.scan, context.scene.fresco.active_region
        self._uid = region.uid
        inside = bridge.read_faces(context.scene, region)
        data = meshes.read_vertices(scan), meshes.read_faces(scan.data)
        return beside_job(mended_faces_job(inside, self.action, *data))

    def finish(self, context: bpy.types.Context, result: BoolArray) -> None:
        bridge.write_faces(context.scene, bridge.region_of(context.scene, self._uid), result)


def mended_faces_job(inside: BoolArray, action: str, vertices: FloatArray, faces: IntArray) -> Job[BoolArray]:
    """Mend a set of faces (F,) of a scan: vertices (V,3) m, faces (F,3)."""
    yield Progress(0.1, "Finding neighbours")
    pair = edge_pairs(faces, len(vertices)).face
    area = face_normals(vertices, faces)[1]
    yield Progress(0.7, "Mending the region")
    mended = {
        "FILL": lambda: face_sets.faces_without_holes(inside, pair, area),
        "SMOOTH": lambda: face_sets.smoothed_faces(inside, pair),
        "SPECKS": lambda: face_sets.faces_without_specks(inside, pair, area),
        "GROW": lambda: face_sets.grown_faces(inside, pair),
        "SHRINK": lambda: face_sets.shrunk_faces(inside, pair),
        "INVERT": lambda: ~inside,
    }[action]()
    if not mended.any():
        raise RegionError("No face of the region would be left.")
    return mended


class FRESCO_OT_clear_hidden(StepOperator):
    bl_idname = "fresco.clear_hidden"
    bl_label = "Nothing Hides It"
    bl_description = "Forget what stands before the chosen region in this photo"
    bl_options = {"UNDO"}
    step = "regions"

    @classmethod
    def ready(cls, context: bpy.types.Context) -> bool:
        photo = shown_mark_photo(context)
        cls.poll_message_set("No part of the chosen region is marked as hidden in this photo")
        return photo is not None and photo.mark(context.scene.fresco.active_region.uid).hidden is not None

    def run(self, context: bpy.types.Context) -> None:
        shown_mark_photo(context).mark(context.scene.fresco.active_region.uid).hidden = None


CLASSES = (FRESCO_OT_tidy_mark, FRESCO_OT_tidy_faces, FRESCO_OT_clear_hidden)
