"""Where a stroke goes: which photo, which region, added or taken away.

And pixels of the window and the photo.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...core.arrays import ArrayLike, BoolArray, FloatArray
from ...core.photos import RegionMark
from ...core.regions.outline import checked_selection, combined
from ..bridge import regions as bridge
from ..bridge.images import read_mask_pixels
from ..properties import FrescoPhoto, FrescoRegion


def stroke_mode(event: bpy.types.Event) -> str:
    """How a stroke combines with the region: shift adds, ctrl takes away."""
    return "subtract" if event.ctrl else "add" if event.shift else "replace"


def shown_photo(context: bpy.types.Context) -> FrescoPhoto | None:
    """Return the photo that the Image Editor shows."""
    space = context.space_data
    image = space.image if space is not None and space.type == "IMAGE_EDITOR" else None
    if image is None:
        return None
    return next((photo for photo in context.scene.fresco.photos if photo.image == image), None)


def photo_region(context: bpy.types.Context, photo: FrescoPhoto, mode: str) -> FrescoRegion:
    """Return the region a stroke in a photo marks.

    The chosen one, or a new one if that is marked here already.
    """
    region = context.scene.fresco.active_region
    if region is None or (mode == "replace" and photo.mark(region.uid) is not None):
        return bridge.add_region(context.scene, "Region")
    return region


def scan_region(context: bpy.types.Context, mode: str) -> FrescoRegion:
    """Return the region a stroke on the scan marks.

    The chosen one, or a new one if that has faces already.
    """
    region = context.scene.fresco.active_region
    if region is None or (mode == "replace" and region.face_count > 0):
        return bridge.add_region(context.scene, "Region")
    return region


def mark_photo(context: bpy.types.Context, photo: FrescoPhoto, stroke: BoolArray, mode: str) -> FrescoRegion:
    """Combine a stroke (H,W) with the region's mark in a photo."""
    checked_selection(stroke)
    region = photo_region(context, photo, mode)
    mark = photo.mark(region.uid)
    earlier = None if mark is None or mark.image is None else read_mask_pixels(mark.image)
    write_mask(photo, region, checked_selection(combined(earlier, stroke, mode)))
    return region


def write_mask(photo: FrescoPhoto, region: FrescoRegion, mask: BoolArray) -> None:
    """Keep a mask (H,W) as the mark of a region in a photo."""
    bridge.write_mark(photo, region, RegionMark(region.name, mask=mask), mask.shape[::-1])


def mark_scan(context: bpy.types.Context, faces: ArrayLike, mode: str) -> FrescoRegion:
    """Combine faces (n,) with the region's faces on the scan."""
    region = scan_region(context, mode)
    earlier = bridge.read_faces(context.scene, region)
    stroke = np.zeros(len(earlier), dtype=np.bool_)
    stroke[np.asarray(faces, dtype=np.int64)] = True
    bridge.write_faces(context.scene, region, combined(earlier, stroke, mode))
    return region


def to_pixel(context: bpy.types.Context, x: float, y: float, size: tuple[int, int]) -> FloatArray:
    """Pixel (u, v) of a photo of `size` under a place of the region (x right, y up, from its corner).

    Blender's view has (0, 0) at the image's lower left corner; core has it at the centre of the top-left
    pixel.
    """
    u, v = context.region.view2d.region_to_view(x, y)
    return np.array([u * size[0] - 0.5, (1 - v) * size[1] - 0.5])


def to_region(context: bpy.types.Context, pixels: FloatArray, size: tuple[int, int]) -> FloatArray:
    """Places (n,2) in the region of pixels (n,2) of a photo of `size`."""
    view = context.region.view2d
    low = np.array(view.view_to_region(-100.0, -100.0, clip=False), dtype=np.float64)
    high = np.array(view.view_to_region(100.0, 100.0, clip=False), dtype=np.float64)
    shown = np.stack([(pixels[:, 0] + 0.5) / size[0], 1 - (pixels[:, 1] + 0.5) / size[1]], axis=1)
    return low + (shown + 100.0) / 200.0 * (high - low)


def pixels_per_photo_pixel(context: bpy.types.Context, size: tuple[int, int]) -> float:
    """Screen pixels that one pixel of the photo covers."""
    ends = to_region(context, np.array([[0.0, 0.0], [1000.0, 0.0]]), size)
    return float(ends[1, 0] - ends[0, 0]) / 1000.0
