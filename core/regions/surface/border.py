"""The border of a region on the scan, exact to the face: a minimum cut that runs along creases and steps.

Source: Boykov and Kolmogorov, An experimental comparison of min-cut/max-flow algorithms, 2004; the
pull of the faces to either side after Chan and Vese, Active contours without edges, 2001.
"""

from __future__ import annotations

import maxflow
import numpy as np

from ...arrays import BoolArray, FloatArray, IndexArray, IntArray
from .graph import from_neighbours
from .index import SurfaceIndex
from .robust_fit import SurfaceFit

_HALF_TURNED = 50.0  # degrees to the fit at which a face belongs to either side alike
_ROUNDING = 3.0  # distances of neighbouring faces that an edge may be rounded by
_TURN = 4.0  # degrees between neighbours at which a cut costs a third
_CHEAPEST = 0.05  # share of its length that a cut along the sharpest crease costs
_PULL = 0.5  # how much a face's own agreement counts against the length of the cut
_ROUNDS = 3.0  # of averaging normals, per noise over distance of faces
_AROUND = 3  # patches from the border whose height tells that of either side


def refined_border(index: SurfaceIndex, patches: IndexArray, fit: SurfaceFit, tolerance: float) -> BoolArray:
    """Set of faces (F,) of a region: patches (n,) with their border moved to the nearest crease or step.

    Inside the band of patches along the border every face is free; the patches behind them are fixed. A face
    agrees when it has not turned halfway to the neighbouring surface, and its height over the fit is nearer
    to that of the region than to what lies beyond, or within `tolerance` (m) where that drops away.
    """
    table = index.patches
    chosen = np.zeros(len(table.area), dtype=np.bool_)
    chosen[patches] = True
    inside: BoolArray = chosen[table.label]
    crossing = table.pair[chosen[table.pair[:, 0]] != chosen[table.pair[:, 1]]]
    if len(crossing) == 0:
        return inside
    border = np.zeros(len(chosen), dtype=np.bool_)
    border[crossing] = True
    band = border.copy()
    band[table.pair[border[table.pair[:, 0]] | border[table.pair[:, 1]]]] = True
    numbers = np.flatnonzero(band)
    faces = table.faces(numbers)
    pair = table.face_pairs(numbers, faces)
    fixed = ~border[table.label[faces]]
    within, beyond = _heights(index, chosen, border, fit)
    label = table.label[faces]
    agreement = _agreement(index, faces, pair, fit, tolerance, (within[label], beyond[label]))
    inside[faces] = _cut(index, faces, pair, inside[faces], fixed, agreement)
    return inside


def _heights(
    index: SurfaceIndex, chosen: BoolArray, border: BoolArray, fit: SurfaceFit
) -> tuple[FloatArray, FloatArray]:
    """Heights (P,) m over the fit of the region and of what lies beyond, near every patch of the border.

    Patches that touch the border tell neither; NaN where none is near.
    """
    table = index.patches
    near = border.copy()
    for _ in range(_AROUND):
        near[table.pair[near[table.pair[:, 0]] | near[table.pair[:, 1]]]] = True
    number = np.flatnonzero(near)
    place = np.cumsum(near) - 1
    pair = place[table.pair[near[table.pair[:, 0]] & near[table.pair[:, 1]]]]
    off = fit.distance(table.middle[number])
    sides = []
    for side in (chosen, ~chosen):
        known = (side & ~border)[number].astype(np.float64)
        total, count = off * known, known
        for _ in range(_AROUND):
            sums = np.stack([total, count], axis=1)
            total, count = (sums + from_neighbours(sums, pair)).T
        height = np.full(len(chosen), np.nan)
        height[number] = np.divide(total, count, out=np.full(len(off), np.nan), where=count > 0)
        sides.append(height)
    return sides[0], sides[1]


def _cut(
    index: SurfaceIndex,
    faces: IndexArray,
    pair: IntArray,
    inside: BoolArray,
    fixed: BoolArray,
    agreement: FloatArray,
) -> BoolArray:
    """Which faces (n,) lie inside the cheapest border; `fixed` ones stay as they are."""
    pull = _PULL * index.area[faces] / index.spacing * agreement
    pull = np.where(fixed, np.where(inside, np.inf, -np.inf), pull)
    smooth = index.smooth_normal[faces].astype(np.float64)
    cosine = np.clip(np.einsum("nk,nk->n", smooth[pair[:, 0]], smooth[pair[:, 1]]), -1, 1)
    turn = np.degrees(np.arccos(cosine)) / _TURN
    cost = index.spacing * (_CHEAPEST + np.exp(-(turn**2)))
    graph = maxflow.GraphFloat(len(faces), len(pair))
    node = graph.add_nodes(len(faces))
    graph.add_edges(pair[:, 0], pair[:, 1], cost, cost)
    strong = 1e6 * index.spacing
    graph.add_grid_tedges(node, np.clip(pull, 0, strong), np.clip(-pull, 0, strong))
    graph.maxflow()
    # PyMaxflow's segment 0 is the source's side.
    within: BoolArray = ~graph.get_grid_segments(node)
    return within


def _agreement(
    index: SurfaceIndex,
    faces: IndexArray,
    pair: IntArray,
    fit: SurfaceFit,
    tolerance: float,
    heights: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """How well faces (n,) agree with a region: 1 wholly, 0 undecided, -1 not at all.

    `heights` (n,), (n,) m are those of the region and of its surroundings over the fit, near every face. A
    rounded edge leaves the surface by about a face's size before it has turned halfway.
    """
    within, beyond = heights
    middle = index.middle[faces].astype(np.float64)
    count = 1 + np.bincount(pair.ravel(), minlength=len(faces))[:, None]
    off = fit.distance(middle)[:, None]
    off = (off + from_neighbours(off, pair)) / count
    normal: FloatArray = index.normal[faces].astype(np.float64)
    for _ in range(int(np.ceil(_ROUNDS * index.noise / max(index.spacing, 1e-12)))):
        normal = (normal + from_neighbours(normal, pair)) / count
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    cosine = np.abs(np.einsum("nk,nk->n", normal, fit.normals(middle)))
    turned = np.degrees(np.arccos(np.clip(cosine, 0, 1)))
    step = np.abs(np.nan_to_num(beyond - within, nan=np.inf))
    reach = np.clip(0.5 * step, 1e-12, max(tolerance, _ROUNDING * index.spacing, 1e-12))
    leaves = np.abs(off[:, 0] - np.nan_to_num(within))
    agreement: FloatArray = np.clip(2.0 * (1.0 - np.maximum(leaves / reach, turned / _HALF_TURNED)), -1, 1)
    return agreement
