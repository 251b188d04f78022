"""Regions of the scan carried into a photo whose pose is known: seeds, snapped to that photo's own edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import ArrayLike, FloatArray
from ..cameras.base import Camera
from ..errors import RegionError
from ..geometry.contours import resampled
from ..geometry.outlines import fill_loops, loop_area
from ..geometry.rays import RayCaster
from ..geometry.rigid import camera_centre
from .image_region import ImageRegion
from .photo.snap import snap_outline
from .surface_region import SurfaceRegion

_SAMPLES = 400  # points per boundary loop
_MOVED = 0.8  # share of the reach at which a snapped outline counts as lost


@dataclass(frozen=True, eq=False)
class TransferredRegion:
    """A region found in another photo.

    `seed` is the scan's outline as projected, `region` the same on the photo's edges; `shift` (pixels) is
    how far the
    outline moved in the median, `seen` the share of the outline that nothing hides.
    """

    seed: ImageRegion
    region: ImageRegion
    shift: float
    seen: float


def project_region(
    camera: Camera, rotation: ArrayLike, translation: ArrayLike, surface: SurfaceRegion
) -> tuple[FloatArray, ...]:
    """Boundary loops of a surface region in the photo.

    Pose world to camera (3,3), (3,) m -> loops (n,2) of pixels.

    Raises
    ------
    RegionError
        A part of the boundary lies outside the camera's field.
    """
    turn, shift = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)
    loops = []
    for loop in surface.loops:
        length = np.linalg.norm(np.diff(loop, axis=0, append=loop[:1]), axis=1).sum()
        pixels = camera.project(resampled(loop, float(length) / _SAMPLES) @ turn.T + shift)
        if not np.all(np.isfinite(pixels)):
            raise RegionError(f"Region '{surface.name}' is not wholly in front of the camera.")
        loops.append(pixels)
    if loop_area(loops) < 0:  # seen from behind, or wound the other way
        loops = [loop[::-1].copy() for loop in loops]
    return tuple(loops)


def transfer_region(
    image: ArrayLike,
    camera: Camera,
    rotation: ArrayLike,
    translation: ArrayLike,
    surface: SurfaceRegion,
    reach: float,
    scene: RayCaster | None = None,
) -> TransferredRegion:
    """Project a surface region into a photo (H,W,3) and snap its outline within `reach` pixels.

    `scene` tells what stands in front.

    Raises
    ------
    RegionError
        The region is not wholly in the photo, mostly hidden, or its outline finds no edge nearby.
    """
    seed = project_region(camera, rotation, translation, surface)
    inside = [camera.in_frame(loop, margin=2) for loop in seed]
    if not all(np.all(flags) for flags in inside):
        raise RegionError(f"Region '{surface.name}' is cut off by the photo's edge here.")
    seen = _seen_share(scene, rotation, translation, surface)
    if seen < 0.7:
        raise RegionError(f"Region '{surface.name}' is hidden here: only {seen:.0%} of its outline is seen.")
    snapped = tuple(snap_outline(image, loop, reach) for loop in seed)
    shift = float(np.median(_distance(snapped[0], seed[0])))
    if shift > _MOVED * reach:
        raise RegionError(
            f"The outline of region '{surface.name}' finds no edge within {reach:.0f} pixels of where "
            "the pose expects it: check the pose, or mark the region by hand."
        )
    frame = camera.width, camera.height
    region = ImageRegion(snapped, surface.name, frame)
    return TransferredRegion(ImageRegion(seed, surface.name, frame), region, shift, seen)


def _seen_share(
    scene: RayCaster | None, rotation: ArrayLike, translation: ArrayLike, surface: SurfaceRegion
) -> float:
    """Share of points just inside the boundary that nothing hides."""
    if scene is None:
        return 1.0
    middle = surface.vertices[surface.faces].mean(axis=1)
    middle = middle[:: max(1, len(middle) // 500)]
    size = float(np.linalg.norm(np.ptp(middle, axis=0)))
    hidden = scene.occluded(camera_centre(rotation, translation), middle, tolerance=0.02 * size)
    return 1.0 - float(np.mean(hidden))


def _distance(moved: FloatArray, loop: FloatArray) -> FloatArray:
    """Distance (n,) of points from the nearest vertex of a finely sampled loop."""
    fine = resampled(loop, 0.5)
    nearest = [float(np.min(np.linalg.norm(fine - point, axis=1))) for point in moved]
    return np.array(nearest)


def overlap(first: ImageRegion, second: ImageRegion, camera: Camera, size: int = 800) -> float:
    """Intersection over union of two regions of one photo, on a grid of at most `size` pixels."""
    factor = min(1.0, size / max(camera.width, camera.height))
    width, height = max(1, round(camera.width * factor)), max(1, round(camera.height * factor))
    masks = [
        fill_loops([(loop + 0.5) * factor - 0.5 for loop in region.loops], width, height)
        for region in (first, second)
    ]
    union = np.count_nonzero(masks[0] | masks[1])
    return np.count_nonzero(masks[0] & masks[1]) / union if union else 0.0
