"""The border of a region on the scan, exact to the face: a minimum cut that runs along creases.

Source: Boykov and Kolmogorov, An experimental comparison of min-cut/max-flow algorithms, 2004.
"""

from __future__ import annotations

import maxflow
import numpy as np

from ..arrays import BoolArray, FloatArray, IndexArray, IntArray
from .robust_fit import SurfaceFit
from .surface_graph import from_neighbours
from .surface_index import SurfaceIndex

_HALF_TURNED = 45.0  # degrees to the fit at which a face belongs to either side alike
_ROUNDING = 1.5  # distances of neighbouring faces that an edge may be rounded by
_TURN = 6.0  # degrees between neighbours at which a cut costs a third
_CHEAPEST = 0.05  # share of its length that a cut along the sharpest crease costs
_PULL = 0.35  # how much a face's own agreement counts against the length of the cut


def refined_border(index: SurfaceIndex, patches: IndexArray, fit: SurfaceFit, tolerance: float) -> BoolArray:
    """Set of faces (F,) of a region: patches (n,) with their border moved to the nearest crease.

    Inside the band of patches along the border every face is free; the patches behind them are fixed. A face
    agrees when it lies within `tolerance` (m) of the fit and has not turned halfway to the neighbouring
    surface.
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
    inside[faces] = _cut(index, faces, pair, inside[faces], fixed, fit, tolerance)
    return inside


def _cut(
    index: SurfaceIndex,
    faces: IndexArray,
    pair: IntArray,
    inside: BoolArray,
    fixed: BoolArray,
    fit: SurfaceFit,
    tolerance: float,
) -> BoolArray:
    """Which faces (n,) lie inside the cheapest border; `fixed` ones stay as they are."""
    pull = _PULL * index.area[faces] / index.spacing * _agreement(index, faces, pair, fit, tolerance)
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
    index: SurfaceIndex, faces: IndexArray, pair: IntArray, fit: SurfaceFit, tolerance: float
) -> FloatArray:
    """How well faces (n,) agree with a fit: 1 wholly, 0 undecided, -1 not at all.

    A rounded edge leaves the surface by about a face's size before it has turned halfway.
    """
    middle = index.middle[faces].astype(np.float64)
    count = 1 + np.bincount(pair.ravel(), minlength=len(faces))
    off = fit.distance(middle)[:, None]
    off = (off + from_neighbours(off, pair))[:, 0] / count
    cosine = np.einsum("nk,nk->n", index.smooth_normal[faces], fit.normals(middle))
    turned = np.degrees(np.arccos(np.clip(np.abs(cosine), 0, 1)))
    doubt = np.maximum(np.abs(off) / max(tolerance, _ROUNDING * index.spacing, 1e-12), turned / _HALF_TURNED)
    agreement: FloatArray = np.clip(2.0 * (1.0 - doubt), -1.0, 1.0)
    return agreement
