"""What the solver works on: regions checked, brought to one origin and one chart each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray
from ...cameras.base import Camera
from ...errors import RegionError
from ...geometry.boundary import without_collinear
from ...geometry.charts import chart_around
from ...geometry.outlines import loop_area
from ...regions import ImageRegion, SurfaceRegion
from ...regions.image_region import described
from .moment_pair import Edges, MomentPair, moment_pair

AreaOf = Callable[[FloatArray], float]

SMALLEST_AREA = 60.0
"""Square pixels below which an outline tells nothing about a pose."""

SPECKLE = 0.01
"""Loops smaller than this share of their region's largest are dropouts of a scan or slips of a wand."""

COLLINEAR = 2e-5
"""Boundary vertices this close to a straight line, as a share of the region's size, are left out."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Regions of one photo relative to `origin` (3,) in the world, so that large coordinates cost no digits.

    `pixel_loops[i]` are the photo's outlines (n,2) in pixels, `surface_loops[j]` the boundaries (n,3) in
    metres from the origin; `pairs[k]` join them. Paired: one pair per region. Unpaired: one pair over all.
    """

    camera: Camera
    origin: FloatArray
    pixel_loops: tuple[tuple[FloatArray, ...], ...]
    surface_loops: tuple[tuple[FloatArray, ...], ...]
    pairs: tuple[MomentPair, ...]
    paired: bool


def make_problem(
    camera: Camera,
    image_regions: Sequence[ImageRegion],
    surface_regions: Sequence[SurfaceRegion],
    paired: bool,
) -> Problem:
    """Check the regions and prepare their equations.

    Raises
    ------
    RegionError
        No regions, numbers that do not fit, or a region that cannot be used; the text says which and why.
    """
    _check_numbers(image_regions, surface_regions, paired)
    for region in image_regions:
        check_image_region(camera, region)
    origin = _origin(surface_regions)
    pixels = tuple(_without_speckles(region.loops, _pixel_area) for region in image_regions)
    surfaces = tuple(
        _without_speckles(tuple(loop - origin for loop in region.loops), _space_area)
        for region in surface_regions
    )
    parts = [_simplified(loops) for loops in surfaces]
    if paired:
        pairs = [_pair(camera, loops, [part]) for loops, part in zip(pixels, parts, strict=True)]
    else:
        pairs = [_pair(camera, [loop for loops in pixels for loop in loops], parts)]
    return Problem(camera, origin, pixels, surfaces, tuple(pairs), paired)


def check_image_region(camera: Camera, region: ImageRegion) -> None:
    """Refuse a region of the photo that cannot give a pose.

    Raises
    ------
    RegionError
        Mask of another size than the photo, too small, touching the photo's edge, or beyond the lens's field.
    """
    name = described(region.name)
    if region.frame is not None and region.frame != (camera.width, camera.height):
        raise RegionError(
            f"{name}: the mask has {region.frame[0]} x {region.frame[1]} pixels, the photo "
            f"{camera.width} x {camera.height}: draw it on the photo at its full size."
        )
    if region.area < SMALLEST_AREA:
        raise RegionError(f"{name} has only {region.area:.0f} pixels: too small to find a pose from.")
    points = np.concatenate(region.loops)
    if not np.all(camera.in_frame(points, margin=0.25)):
        raise RegionError(
            f"{name} touches the edge of the photo, so part of its outline is missing: "
            "leave it out or choose a region that is wholly visible."
        )


def _check_numbers(
    image_regions: Sequence[ImageRegion], surface_regions: Sequence[SurfaceRegion], paired: bool
) -> None:
    if not image_regions or not surface_regions:
        raise RegionError("A pose needs at least one region in the photo and its partner on the scan.")
    if paired and len(image_regions) != len(surface_regions):
        raise RegionError(
            f"{len(image_regions)} regions in the photo but {len(surface_regions)} on the scan: every one "
            "needs its partner, in the same order (or solve them unpaired)."
        )


def _origin(surface_regions: Sequence[SurfaceRegion]) -> FloatArray:
    """Middle of the regions' centres (3,)."""
    centres = np.array([region.centre for region in surface_regions])
    middle: FloatArray = centres[0] + np.mean(centres - centres[0], axis=0)
    return middle


def _pair(camera: Camera, loops: Sequence[FloatArray], parts: Sequence[Edges]) -> MomentPair:
    rays = [camera.unproject(loop) for loop in loops]
    bundle = np.concatenate(rays)
    if not np.all(np.isfinite(bundle)):
        raise RegionError(
            "A region reaches beyond the field of the camera's lens model: leave that part out."
        )
    chart = chart_around(bundle)
    return moment_pair(chart, loop_edges([chart.flatten(loop) for loop in rays]), tuple(parts))


def loop_edges(loops: Sequence[FloatArray]) -> Edges:
    """Directed edges of closed loops: starts and ends (E,d)."""
    return np.concatenate(list(loops)), np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])


def _simplified(loops: Sequence[FloatArray]) -> Edges:
    size = float(np.linalg.norm(np.ptp(np.concatenate(list(loops)), axis=0)))
    return loop_edges([without_collinear(loop, COLLINEAR * size) for loop in loops])


def _without_speckles(loops: tuple[FloatArray, ...], area: AreaOf) -> tuple[FloatArray, ...]:
    areas = [area(loop) for loop in loops]
    return tuple(loop for loop, size in zip(loops, areas, strict=True) if size >= SPECKLE * max(areas))


def _pixel_area(loop: FloatArray) -> float:
    return abs(loop_area([loop]))


def _space_area(loop: FloatArray) -> float:
    """Area that a loop (n,3) spans: half the length of its area vector."""
    local = loop - loop[0]
    return 0.5 * float(np.linalg.norm(np.cross(local, np.roll(local, -1, axis=0)).sum(axis=0)))
