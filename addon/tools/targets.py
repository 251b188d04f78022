"""Where a stroke goes: which photo, which region, added or taken away.

And pixels of the window and the photo.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...core.arrays import BoolArray, FloatArray
from ...core.errors import RegionError
from ...core.photos import RegionMark
from ...core.regions.photo.outline import checked_selection, combined
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
    return photo_of(context.scene, image)


def photo_of(scene: bpy.types.Scene, image: bpy.types.Image | None) -> FrescoPhoto | None:
    """Return the photo that has this image."""
    if image is None:
        return None
    return next((photo for photo in scene.fresco.photos if photo.image == image), None)


def stroke_target(context: bpy.types.Context, mode: str, taken: bool) -> FrescoRegion | None:
    """Return the region that a stroke marks: the chosen one, or None where it begins a new one.

    `taken` tells whether the chosen region is marked here already.
    """
    region = context.scene.fresco.active_region
    if region is None or (mode == "replace" and taken and not context.scene.fresco_marking.redo):
        return None
    return region


def mark_photo(context: bpy.types.Context, photo: FrescoPhoto, stroke: BoolArray, mode: str) -> FrescoRegion:
    """Combine a stroke (H,W) with the region's mark in a photo, or with what stands before the region."""
    if context.scene.fresco_marking.part == "HIDDEN":
        return mark_hidden(context, photo, stroke, mode)
    chosen = context.scene.fresco.active_region
    mark = None if chosen is None else photo.mark(chosen.uid)
    region = stroke_target(context, mode, mark is not None)
    earlier = None if region is None or mark is None else read_mask_pixels(mark.image)
    if mode == "subtract" and earlier is None:
        raise RegionError("The chosen region is not marked in this photo: nothing can be taken away.")
    mask = checked_selection(combined(earlier, checked_selection(stroke), mode))
    region = region or bridge.add_region(context.scene, "Region")
    write_mask(photo, region, mask)
    return region


def mark_hidden(context: bpy.types.Context, photo: FrescoPhoto, stroke: BoolArray, mode: str) -> FrescoRegion:
    """Add a stroke (H,W) to what stands before the chosen region in a photo, or take it away with Ctrl."""
    region = context.scene.fresco.active_region
    mark = None if region is None else photo.mark(region.uid)
    if mark is None:
        raise RegionError(
            "Mark the region first, its whole outline as far as you can tell; then what stands before it."
        )
    earlier = None if mark.hidden is None else read_mask_pixels(mark.hidden)
    bridge.write_hidden(photo, region, combined(earlier, stroke, "add" if mode == "replace" else mode))
    return region


def write_mask(photo: FrescoPhoto, region: FrescoRegion, mask: BoolArray) -> None:
    """Keep a mask (H,W) as the mark of a region in a photo."""
    bridge.write_mark(photo, region, RegionMark(region.name, mask=mask), mask.shape[::-1])


def mark_scan(context: bpy.types.Context, stroke: BoolArray, mode: str) -> FrescoRegion:
    """Combine faces (F,) with the region's faces on the scan."""
    chosen = context.scene.fresco.active_region
    region = stroke_target(context, mode, chosen is not None and chosen.is_on_scan)
    earlier = None if region is None else bridge.read_faces(context.scene, region)
    if mode == "subtract" and (earlier is None or not earlier.any()):
        raise RegionError("The chosen region is not on the scan: nothing can be taken away.")
    after = combined(earlier, stroke, mode)
    if not after.any():
        raise RegionError("Nothing of the region would be left: remove the region from the list instead.")
    region = region or bridge.add_region(context.scene, "Region")
    bridge.write_faces(context.scene, region, after)
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
