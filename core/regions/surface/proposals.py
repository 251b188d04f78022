"""Ready regions of the scan to accept or refuse: large smooth facets, and openings.

Nothing here is taken without asking: every proposal carries its score.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import ArrayLike, FloatArray, IndexArray
from ...geometry.boundary import link_loops, without_collinear
from ...geometry.outlines import loop_area
from ...jobs import Job, Progress
from ...settings import RegionSettings
from ..surface_region import SurfaceRegion
from .graph import labelled
from .index import SurfaceIndex
from .opening import points_inside, triangulated
from .robust_fit import fit_plane
from .wand import grow_surface, region_faces


@dataclass(frozen=True, eq=False)
class SurfaceProposal:
    """A facet (`faces` of the scan) or an opening (`faces` empty): its `region`, `area` m² and `score`."""

    region: SurfaceRegion
    faces: IndexArray
    area: float
    score: float


def propose_facets_job(
    index: SurfaceIndex,
    vertices: ArrayLike,
    faces: ArrayLike,
    count: int = 20,
    settings: RegionSettings | None = None,
) -> Job[list[SurfaceProposal]]:
    """The `count` most useful smooth facets of a scan, found as the surface wand finds them.

    Large ones with a clear outline come first; none overlap by half.
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
        area = float(index.area[members].sum())
        found.append(SurfaceProposal(_patch(points, triangles[members]), members, area, level.score))
    best = sorted(found, key=lambda proposal: -proposal.area * np.exp(proposal.score))
    return [_named(proposal, f"Facet {number + 1}") for number, proposal in enumerate(best)]


def _patch(points: FloatArray, triangles: IndexArray) -> SurfaceRegion:
    """Region with the vertices it needs, no others."""
    used, corners = np.unique(triangles, return_inverse=True)
    return SurfaceRegion(points[used], corners.reshape(-1, 3))


def _named(proposal: SurfaceProposal, name: str) -> SurfaceProposal:
    return replace(proposal, region=SurfaceRegion(proposal.region.vertices, proposal.region.faces, name))


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
        seeds.append(int(patches.order[patches.start[patch]]))
    return np.array(seeds, dtype=np.int64)


def propose_openings_job(
    index: SurfaceIndex, vertices: ArrayLike, faces: ArrayLike, least_area: float
) -> Job[list[SurfaceProposal]]:
    """Openings of the scan with flat rims, the largest first.

    Windows, doors and niches without ground, at least `least_area` m². A boundary loop is an opening when the
    surface lies outside it, seen along the normal of its plane.
    """
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    yield Progress(0.0, "Looking for openings")
    rim = _rim(index, triangles)
    edges = _open_edges(rim, triangles, index)
    loops = [loop for loop in link_loops(edges[:, 0], edges[:, 1]) if len(loop) >= 4]
    proposals: list[SurfaceProposal] = []
    for number, loop in enumerate(loops):
        if number % 50 == 0:
            yield Progress(0.5 + 0.5 * number / len(loops), f"Looking for openings: {len(proposals)}")
        proposal = _opening(points, triangles[rim], loop, least_area)
        if proposal is not None:
            proposals.append(proposal)
    largest = sorted(proposals, key=lambda proposal: -proposal.area)
    return [_named(proposal, f"Opening {number + 1}") for number, proposal in enumerate(largest)]


def _rim(index: SurfaceIndex, triangles: IndexArray) -> IndexArray:
    """Faces (n,) with an edge that no other face has."""
    count = np.bincount(index.pair.ravel(), minlength=len(triangles))
    return np.flatnonzero(count < 3)


def _open_edges(rim: IndexArray, triangles: IndexArray, index: SurfaceIndex) -> IndexArray:
    """Directed edges (E,2) of rim faces that no other face has."""
    on_rim = np.zeros(len(triangles), dtype=np.bool_)
    on_rim[rim] = True
    around = on_rim.copy()
    around[index.pair[on_rim[index.pair[:, 0]] | on_rim[index.pair[:, 1]]]] = True
    near = np.flatnonzero(around)
    edges = np.stack([triangles[near], np.roll(triangles[near], -1, axis=1)], axis=2).reshape(-1, 2)
    key = edges.min(axis=1) * (int(triangles.max()) + 1) + edges.max(axis=1)
    which, count = np.unique(key, return_inverse=True, return_counts=True)[1:]
    single = (count[which.reshape(-1)] == 1) & np.repeat(on_rim[near], 3)
    open_edges: IndexArray = edges[single]
    return open_edges


def _opening(
    points: FloatArray, triangles: IndexArray, loop: IndexArray, least_area: float
) -> SurfaceProposal | None:
    """Opening inside a boundary loop, or None where it is none: `triangles` are those along boundaries."""
    rim = points[loop]
    plane = fit_plane(rim, share=0.75)
    flat = (rim - plane.centre) @ plane.axes[:2].T
    area = abs(loop_area([flat]))
    if area < least_area or np.quantile(np.abs(plane.distance(rim)), 0.9) > 0.1 * np.sqrt(area):
        return None
    if _surface_inside(points, triangles, loop, plane.centre, plane.axes):
        return None
    corners = without_collinear(flat, 0.02 * float(np.sqrt(area)))
    patch = triangulated(corners)
    if len(patch) == 0:
        return None
    flatness = float(np.median(np.abs(plane.distance(rim)))) / float(np.sqrt(area))
    region = SurfaceRegion(plane.centre + corners @ plane.axes[:2], patch)
    return SurfaceProposal(region, np.zeros(0, dtype=np.int64), area, -flatness)


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
