"""Ready regions to accept or refuse.

Facets and openings of the scan, frames of the photo, and likely partners.

Nothing here is taken without asking: every proposal carries its score.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial import Delaunay

from ..arrays import ArrayLike, BoolArray, FloatArray, IndexArray
from ..cameras.base import Camera
from ..errors import FrescoError, RegionError
from ..geometry.boundary import boundary_loops, without_collinear
from ..geometry.outlines import loop_area
from ..jobs import Job, Progress
from ..settings import RegionSettings
from .frames import polygon_areas
from .image_region import ImageRegion
from .robust_fit import fit_plane
from .surface_index import SurfaceIndex, labelled
from .surface_region import SurfaceRegion
from .surface_wand import grow_surface, region_faces
from .transfer import overlap, project_region
from .wand import Level, PhotoWand


@dataclass(frozen=True, eq=False)
class SurfaceProposal:
    """A facet (`faces` of the scan) or an opening (`faces` empty): its `region`, `area` m² and `score`."""

    region: SurfaceRegion
    faces: IndexArray
    area: float
    score: float


class _Solved(Protocol):
    @property
    def overlap_error(self) -> float: ...


@dataclass(frozen=True, eq=False)
class PairingProposal:
    """Which surface region may belong to which image region: index pairs, and the pose that they give.

    `error` is the overlap error in percent: the smaller the better.
    """

    pairs: tuple[tuple[int, int], ...]
    error: float
    pose: object


def propose_facets_job(
    index: SurfaceIndex,
    vertices: ArrayLike,
    faces: ArrayLike,
    count: int = 20,
    settings: RegionSettings | None = None,
) -> Job[list[SurfaceProposal]]:
    """The `count` largest smooth facets of a scan, found as the surface wand finds them.

    None overlap by half.
    """
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces)
    taken = np.zeros(index.face_count, dtype=np.bool_)
    found: list[SurfaceProposal] = []
    seeds = _facet_seeds(index, 3 * count)
    for number, seed in enumerate(seeds.tolist()):
        yield Progress(number / len(seeds), f"Looking for facets: {len(found)}")
        if taken[seed] or len(found) == count:
            continue
        level = grow_surface(index, seed, settings).level()
        members = region_faces(index, seed, level)
        if len(members) < 12 or np.count_nonzero(taken[members]) > 0.5 * len(members):
            continue
        taken[members] = True
        region = SurfaceRegion(points, triangles[members], f"Facet {len(found) + 1}")
        found.append(SurfaceProposal(region, members, float(index.area[members].sum()), level.score))
    return sorted(found, key=lambda proposal: -proposal.area)


def _facet_seeds(index: SurfaceIndex, count: int) -> IndexArray:
    """One face in the middle of each of the largest pieces whose normals hardly turn."""
    patches = index.patches
    first, second = patches.pair[:, 0], patches.pair[:, 1]
    alike = np.einsum("nk,nk->n", patches.normal[first], patches.normal[second]) > np.cos(np.radians(8))
    label = labelled(first[alike], second[alike], len(patches.area))
    area = np.bincount(label, patches.area)
    seeds = []
    for piece in np.argsort(-area)[:count]:
        members = np.flatnonzero(label == piece)
        middle = np.average(patches.middle[members], axis=0, weights=patches.area[members])
        patch = members[np.argmin(np.sum((patches.middle[members] - middle) ** 2, axis=1))]
        seeds.append(int(np.flatnonzero(patches.label == patch)[0]))
    return np.array(seeds, dtype=np.int64)


def propose_openings(vertices: ArrayLike, faces: ArrayLike, least_area: float) -> list[SurfaceProposal]:
    """Openings of the scan with flat rims.

    Windows, doors and niches without ground, at least `least_area` m².

    A boundary loop is an opening when the surface lies outside it, seen along the normal of its plane.
    """
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces)
    proposals: list[SurfaceProposal] = []
    for loop in boundary_loops(triangles):
        rim = points[loop]
        plane = fit_plane(rim, share=0.75)
        flat = (rim - plane.centre) @ plane.axes[:2].T
        area = abs(loop_area([flat]))
        if area < least_area or np.quantile(np.abs(plane.distance(rim)), 0.9) > 0.1 * np.sqrt(area):
            continue
        if _surface_inside(points, triangles, loop, plane.centre, plane.axes):
            continue
        corners = without_collinear(flat, 0.02 * float(np.sqrt(area)))
        patch = _triangulated(corners)
        if len(patch) == 0:
            continue
        world = plane.centre + corners @ plane.axes[:2]
        region = SurfaceRegion(world, patch, f"Opening {len(proposals) + 1}")
        flatness = float(np.median(np.abs(plane.distance(rim)))) / float(np.sqrt(area))
        proposals.append(SurfaceProposal(region, np.zeros(0, dtype=np.int64), area, -flatness))
    return sorted(proposals, key=lambda proposal: -proposal.area)


def _surface_inside(
    points: FloatArray, triangles: IndexArray, loop: IndexArray, centre: FloatArray, axes: FloatArray
) -> bool:
    """Whether the faces at a boundary loop lie inside it: then it is the outer border of a piece."""
    on_rim = np.zeros(len(points), dtype=np.bool_)
    on_rim[loop] = True
    beside = triangles[np.count_nonzero(on_rim[triangles], axis=1) >= 2]
    middle = (points[beside].mean(axis=1) - centre) @ axes[:2].T
    inside = points_inside((points[loop] - centre) @ axes[:2].T, middle)
    return bool(np.mean(inside) > 0.5)


def points_inside(polygon: FloatArray, points: FloatArray) -> BoolArray:
    """Whether points (N,2) lie in a polygon (n,2), by the even-odd rule."""
    inside = np.zeros(len(points), dtype=np.bool_)
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        crosses = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
        if a[1] != b[1]:
            inside ^= crosses & (points[:, 0] < a[0] + (points[:, 1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]))
    return inside


def _triangulated(corners: FloatArray) -> IndexArray:
    """Triangles (F,3) inside a simple polygon (n,2)."""
    triangles: IndexArray = Delaunay(corners).simplices.astype(np.int64)
    large = polygon_areas(corners[triangles]) > 1e-9 * float(np.ptp(corners, axis=0).max()) ** 2
    return triangles[large & points_inside(corners, corners[triangles].mean(axis=1))]


def propose_image_regions_job(wand: PhotoWand, count: int = 12, across: int = 7) -> Job[list[Level]]:
    """Frames and closed areas of a photo, best first.

    The wand clicked on a grid, `across` times side to side.
    """
    height, width = wand.image.shape[:2]
    step = width / across
    rows, columns = np.arange(step / 2, height, step).tolist(), np.arange(step / 2, width, step).tolist()
    grid = list(itertools.product(columns, rows))
    camera_size = np.array([width, height])
    found: list[tuple[Level, BoolArray]] = []
    for number, pixel in enumerate(grid):
        yield Progress(number / len(grid), f"Looking for regions: {len(found)}")
        try:
            level = wand.click(pixel).level()
        except RegionError:
            continue
        cut_off = np.any(level.outline < 2) or np.any(level.outline > camera_size - 3)
        if cut_off or level.area < 1e-3 * width * height:
            continue
        mask = wand.mask([level.outline])[::8, ::8]
        rival = [k for k, other in enumerate(found) if _alike(mask, other[1])]
        if not rival:
            found.append((level, mask))
        elif level.score > found[rival[0]][0].score:
            found[rival[0]] = (level, mask)
    return [level for level, _ in sorted(found, key=lambda pair: -pair[0].score)[:count]]


def _alike(first: BoolArray, second: BoolArray) -> bool:
    union = np.count_nonzero(first | second)
    return union > 0 and np.count_nonzero(first & second) > 0.6 * union


def propose_partners(
    camera: Camera,
    rotation: ArrayLike,
    translation: ArrayLike,
    image_regions: Sequence[ImageRegion],
    surface_regions: Sequence[SurfaceRegion],
    least_overlap: float = 0.3,
) -> list[tuple[int, int, float]]:
    """Partners by projecting with a rough pose: (image region, surface region, overlap 0..1), best first.

    Every region is used once at most.
    """
    candidates = []
    for j, surface in enumerate(surface_regions):
        try:
            projected = ImageRegion(project_region(camera, rotation, translation, surface))
        except RegionError:  # behind the camera: no partner in this photo
            continue
        for i, region in enumerate(image_regions):
            share = overlap(region, projected, camera)
            if share >= least_overlap:
                candidates.append((i, j, share))
    chosen: list[tuple[int, int, float]] = []
    for i, j, share in sorted(candidates, key=lambda entry: -entry[2]):
        if all(i != a and j != b for a, b, _ in chosen):
            chosen.append((i, j, share))
    return chosen


def propose_pairings_job(
    solve: Callable[[Sequence[ImageRegion], Sequence[SurfaceRegion]], _Solved],
    image_regions: Sequence[ImageRegion],
    surface_regions: Sequence[SurfaceRegion],
    count: int = 5,
    limit: int = 200,
) -> Job[list[PairingProposal]]:
    """Pairings without a pose.

    Combinations of two regions, each solved and scored; the best `count` to choose from.

    `solve` is the pose solver, called with paired regions; it raises FrescoError where a pairing cannot be.
    More than `limit` combinations are refused: the user has to choose fewer regions.
    """
    images, surfaces = range(len(image_regions)), range(len(surface_regions))
    together = min(2, len(images), len(surfaces))
    if together == 0:
        raise RegionError("Mark regions in the photo and on the scan first.")
    trials = [
        tuple(zip(some, others, strict=True))
        for some in itertools.combinations(images, together)
        for others in itertools.permutations(surfaces, together)
    ]
    if len(trials) > limit:
        raise RegionError(
            f"{len(trials)} combinations are too many to try: choose at most four regions in the photo "
            "and on the scan."
        )
    proposals = []
    for number, pairs in enumerate(trials):
        yield Progress(number / len(trials), f"Trying pairing {number + 1} of {len(trials)}")
        try:
            pose = solve([image_regions[i] for i, _ in pairs], [surface_regions[j] for _, j in pairs])
        except FrescoError:  # this pairing has no pose, which is what the trial was to tell
            continue
        proposals.append(PairingProposal(pairs, pose.overlap_error, pose))
    return sorted(proposals, key=lambda proposal: proposal.error)[:count]
