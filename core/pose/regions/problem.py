"""What the solver works on: regions checked, brought to one origin and one chart each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import BoolArray, FloatArray
from ...cameras.base import Camera
from ...errors import RegionError
from ...geometry.boundary import subdivided, without_collinear
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

WHOLE = 0.02
"""Share of an outline that may be hidden while the region still counts as whole."""

SHORT = 4.0
"""Longest step (px) of an outline that is taken for straight in any lens."""

COLLINEAR = 2e-5
"""Boundary vertices this close to a straight line, as a share of the region's size, are left out."""


SKETCHED = 4e-3
"""The same for the first steps from a start."""

MOST_WAYS = 64
"""Pairs of unpaired regions that starts are sought from."""

SKETCHED_LOOP = 0.1
"""Share of the largest loop's area from which a loop counts in a sketch."""


@dataclass(frozen=True, eq=False)
class OutlinePair:
    """What should coincide in the photo: outlines (n,2) px, and boundaries of regions, each loops (n,3) m.

    `hidden` (H,W) marks pixels where the outline is not seen; a `partial` pair lacks part of its shape, so
    that its moments tell nothing.
    """

    outlines: tuple[FloatArray, ...]
    boundaries: tuple[tuple[FloatArray, ...], ...]
    hidden: BoolArray | None
    partial: bool


@dataclass(frozen=True, eq=False)
class Problem:
    """Regions of one photo relative to `origin` (3,) in the world, so that large coordinates cost no digits.

    `outlines` holds every pair of regions (unpaired: one pair over all), `moments` the equations of those
    that are whole, `coarse` the same with few edges. `sketches` are coarse pairs of single regions, for
    starts, in groups to be tried one after the other; unpaired regions are paired in every way.
    `whole` are the indices of the pairs with equations, `names` those of all regions of the photo.
    """

    camera: Camera
    origin: FloatArray
    outlines: tuple[OutlinePair, ...]
    moments: tuple[MomentPair, ...]
    coarse: tuple[MomentPair, ...]
    sketches: tuple[tuple[MomentPair, ...], ...]
    whole: tuple[int, ...]
    names: tuple[str, ...]

    @property
    def equations(self) -> int:
        """Number of moment equations."""
        return sum(len(pair.moments) for pair in self.moments)

    def without(self, place: int) -> Problem:
        """Problem whose moments leave out one of its pairs; what is seen of its outline still counts."""
        left_out = self.coarse[place]
        singles = tuple(pair for group in self.sketches for pair in group if pair is not left_out)
        return replace(
            self,
            moments=self.moments[:place] + self.moments[place + 1 :],
            coarse=self.coarse[:place] + self.coarse[place + 1 :],
            whole=self.whole[:place] + self.whole[place + 1 :],
            sketches=(singles[:1], singles[1:]) if len(singles) > 1 else (singles,),
        )


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
    edges = open_edges(camera)
    surfaces = [
        _without_speckles(tuple(loop - origin for loop in region.loops), _space_area)
        for region in surface_regions
    ]
    if paired:
        outlines = [
            _outline_pair(camera, edges, [region], [loops])
            for region, loops in zip(image_regions, surfaces, strict=True)
        ]
    else:
        outlines = [_outline_pair(camera, edges, image_regions, surfaces)]
    whole = _usable_for_moments(outlines, image_regions)
    moments = tuple(_moment_pair(camera, pair) for pair in whole)
    coarse = tuple(_sketch(*both) for both in zip(moments, whole, strict=True))
    if paired:
        drawn = sorted(zip(coarse, whole, strict=True), key=lambda both: -loop_area(both[1].outlines))
        singles = [pair for pair, _ in drawn]
        groups = (tuple(singles[:1]), tuple(singles[1:])) if len(singles) > 1 else (tuple(singles),)
    else:
        groups = (_every_way(camera, edges, image_regions, surfaces),)
    places = tuple(k for k, pair in enumerate(outlines) if any(pair is other for other in whole))
    names = tuple(region.name for region in image_regions)
    return Problem(camera, origin, tuple(outlines), moments, coarse, groups, places, names)


def _every_way(
    camera: Camera,
    edges: BoolArray,
    image_regions: Sequence[ImageRegion],
    surfaces: Sequence[tuple[FloatArray, ...]],
) -> tuple[MomentPair, ...]:
    """Sketches of each region of the photo with each of the surface."""
    combinations = [([region], [loops]) for region in image_regions for loops in surfaces]
    pairs = [_outline_pair(camera, edges, images, parts) for images, parts in combinations[:MOST_WAYS]]
    seen = [pair for pair in pairs if not pair.partial] or pairs
    return tuple(_sketch(_moment_pair(camera, pair), pair) for pair in seen)


def open_edges(camera: Camera) -> BoolArray:
    """Which edges of the frame (left, top, right, bottom) cut the view off: seams and poles do not."""
    u, v = np.linspace(0, camera.width - 1.0, 9), np.linspace(0, camera.height - 1.0, 9)
    left, right = np.full(9, -0.5), np.full(9, camera.width - 0.5)
    top, bottom = np.full(9, -0.5), np.full(9, camera.height - 0.5)
    sides = [
        camera.unproject(np.stack(pixels, axis=1))
        for pixels in ((left, v), (u, top), (right, v), (u, bottom))
    ]
    joined = bool(np.all(np.abs(sides[0] - sides[2]) < 1e-6))
    poles = [bool(np.all(np.abs(side - side[0]) < 1e-6)) for side in (sides[1], sides[3])]
    return ~np.array([joined, poles[0], joined, poles[1]])


def _outline_pair(
    camera: Camera,
    edges: BoolArray,
    regions: Sequence[ImageRegion],
    surfaces: Sequence[tuple[FloatArray, ...]],
) -> OutlinePair:
    loops = tuple(loop for region in regions for loop in _without_speckles(region.loops, _pixel_area))
    hidden = _beyond_frame(camera, loops)
    partial = hidden is not None and _cut_off(camera, edges, loops)
    for region in regions:
        if region.hidden is not None:
            hidden = region.hidden if hidden is None else hidden | region.hidden
            partial = partial or _share_hidden(loops, region.hidden) > WHOLE
    return OutlinePair(loops, tuple(surfaces), hidden, partial)


def touches_frame(camera: Camera, region: ImageRegion) -> bool:
    """Whether the photo's edge cuts a region off."""
    return _cut_off(camera, open_edges(camera), region.loops)


def _cut_off(camera: Camera, edges: BoolArray, loops: Sequence[FloatArray]) -> bool:
    touched = [np.any(_near_edges(camera, loop), axis=0) for loop in loops]
    return bool(np.any(np.any(touched, axis=0) & edges))


def _near_edges(camera: Camera, loop: FloatArray) -> BoolArray:
    """Which of a loop's points (n,2) lie on the left, top, right and bottom edge of the frame: (n,4)."""
    u, v = loop.T
    return np.stack([u < -0.25, v < -0.25, u > camera.width - 0.75, v > camera.height - 0.75], axis=1)


def _beyond_frame(camera: Camera, loops: Sequence[FloatArray]) -> BoolArray | None:
    """Mask of the frame's border if the outline touches it: there the photo ends, not the region."""
    if not any(np.any(_near_edges(camera, loop)) for loop in loops):
        return None
    border = np.zeros((camera.height, camera.width), dtype=bool)
    border[:3] = border[-3:] = border[:, :3] = border[:, -3:] = True
    return border


def _share_hidden(loops: Sequence[FloatArray], hidden: BoolArray) -> float:
    points = np.rint(np.concatenate(list(loops))).astype(np.int64)
    u = np.clip(points[:, 0], 0, hidden.shape[1] - 1)
    v = np.clip(points[:, 1], 0, hidden.shape[0] - 1)
    return float(np.mean(hidden[v, u]))


def _usable_for_moments(
    outlines: Sequence[OutlinePair], image_regions: Sequence[ImageRegion]
) -> list[OutlinePair]:
    """Pairs whose whole shape is known; those with hidden parts only if there are no others.

    Raises
    ------
    RegionError
        Every region is cut off by the photo's edge.
    """
    whole = [pair for pair in outlines if not pair.partial]
    if whole:
        return whole
    drawn = [pair for pair, region in zip(outlines, image_regions, strict=False) if region.hidden is not None]
    if drawn:
        return drawn
    raise RegionError(
        f"{described(image_regions[0].name)} touches the edge of the photo: part of its outline is missing; "
        "mark at least one region that is wholly visible."
    )


def check_image_region(camera: Camera, region: ImageRegion) -> None:
    """Refuse a region of the photo that cannot give a pose.

    Raises
    ------
    RegionError
        Mask of another size than the photo, polygon beyond it, or too small.
    """
    name = described(region.name)
    if region.frame is not None and region.frame != (camera.width, camera.height):
        raise RegionError(
            f"{name}: the mask has {region.frame[0]} x {region.frame[1]} pixels, the photo "
            f"{camera.width} x {camera.height}: draw it on the photo at its full size."
        )
    if region.area < SMALLEST_AREA:
        raise RegionError(f"{name} has only {region.area:.0f} pixels: too small to find a pose from.")
    if not np.all(camera.in_frame(np.concatenate(region.loops))):
        raise RegionError(f"{name} reaches beyond the photo: keep its outline inside.")


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


def _moment_pair(camera: Camera, pair: OutlinePair) -> MomentPair:
    rays = [camera.unproject(_with_short_steps(loop)) for loop in pair.outlines]
    bundle = np.concatenate(rays)
    if not np.all(np.isfinite(bundle)):
        raise RegionError(
            "A region reaches beyond the field of the camera's lens model: leave that part out."
        )
    chart = chart_around(bundle)
    parts = tuple(_simplified(loops, chart.equal_area) for loops in pair.boundaries)
    try:
        return moment_pair(chart, loop_edges([chart.flatten(loop) for loop in rays]), parts)
    except np.linalg.LinAlgError as error:
        raise RegionError(
            "A region in the photo is no patch: its outline is a line or goes round the camera."
        ) from error


def _sketch(exact: MomentPair, pair: OutlinePair) -> MomentPair:
    """Same equations with the large loops only, and these roughly."""
    parts = []
    for loops in pair.boundaries:
        areas = [_space_area(loop) for loop in loops]
        large = [loop for loop, area in zip(loops, areas, strict=True) if area > SKETCHED_LOOP * max(areas)]
        parts.append(_simplified(large, exact.chart.equal_area, SKETCHED))
    return replace(exact, parts=tuple(parts))


def _with_short_steps(loop: FloatArray) -> FloatArray:
    """Outline with steps so short that it may be taken for straight in any lens."""
    steps = np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1)
    return loop if steps.max() <= SHORT else subdivided(loop, SHORT)


def loop_edges(loops: Sequence[FloatArray]) -> Edges:
    """Directed edges of closed loops: starts and ends (E,d)."""
    return np.concatenate(list(loops)), np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])


def _simplified(loops: Sequence[FloatArray], curved_chart: bool, tolerance: float = COLLINEAR) -> Edges:
    """Boundary edges without needless vertices; short ones where the chart bends straight lines."""
    size = float(np.linalg.norm(np.ptp(np.concatenate(list(loops)), axis=0)))
    lean = [without_collinear(loop, tolerance * size) for loop in loops]
    return loop_edges([subdivided(loop, size / 60) for loop in lean] if curved_chart else lean)


def _without_speckles(loops: tuple[FloatArray, ...], area: AreaOf) -> tuple[FloatArray, ...]:
    areas = [area(loop) for loop in loops]
    return tuple(loop for loop, size in zip(loops, areas, strict=True) if size >= SPECKLE * max(areas))


def _pixel_area(loop: FloatArray) -> float:
    return abs(loop_area([loop]))


def _space_area(loop: FloatArray) -> float:
    """Area that a loop (n,3) spans: half the length of its area vector."""
    local = loop - loop[0]
    return 0.5 * float(np.linalg.norm(np.cross(local, np.roll(local, -1, axis=0)).sum(axis=0)))
