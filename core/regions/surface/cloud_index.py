"""A point cloud made ready for the surface wand: its points stand where a mesh has faces."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import cKDTree

from ...arrays import ArrayLike, FloatArray, IndexArray, IntArray
from ...errors import RegionError
from ...geometry.rays import local_centre
from ...jobs import Job, Progress, drain
from .graph import labelled
from .index import SurfaceIndex, byte_colours
from .patches import surface_patches

_NEIGHBOURS = 12  # that make a point's normal
_LINKED = 6  # that growing goes on to
_SLICE = 50_000  # points per step of the job


def index_cloud_job(points: ArrayLike, colours: ArrayLike | None = None) -> Job[SurfaceIndex]:
    """Make a cloud ready for the surface wand: (N,3) m, optional colours (N,3) uint8 sRGB.

    In the result a point takes the place of a face: `grow_surface(index, point)` grows over the nearest
    neighbours, and `region_faces` gives the points of the region.

    Raises
    ------
    RegionError
        Too few points, coordinates that are no numbers, or colours that do not fit the points.

    Source: Hoppe, DeRose, Duchamp, McDonald and Stuetzle, Surface reconstruction from unorganized points,
    1992 (normals by principal components, turned alike along a minimum spanning tree).
    """
    place = np.asarray(points, dtype=np.float64)
    _check(place, colours)
    yield Progress(0.0, "Reading the points")
    centre = local_centre(place)
    local = place - centre
    tree = cKDTree(local)
    count = min(_NEIGHBOURS, len(local) - 1)
    near = np.empty((len(local), count), dtype=np.int64)
    away = np.empty(len(local))
    normal, off = np.empty_like(local), np.empty(len(local))
    for start in range(0, len(local), _SLICE):
        part = slice(start, min(start + _SLICE, len(local)))
        distance, found = (np.asarray(some) for some in tree.query(local[part], count + 1))
        near[part], away[part] = found[:, 1:], distance[:, min(_LINKED, count)]
        normal[part], off[part] = _planes(local[found])
        yield Progress(0.6 * part.stop / len(local), "Finding neighbours")
    pair = _pairs(near[:, :_LINKED])
    yield Progress(0.7, "Turning normals alike")
    normal *= _signs(normal, pair)[:, None]
    yield Progress(0.85, "Joining points to patches")
    noise = float(np.median(off))
    spacing = float(np.median(away)) * np.sqrt(np.pi / _LINKED)
    area = np.pi * away**2 / _LINKED
    colour = None if colours is None else byte_colours(np.asarray(colours, dtype=np.uint8))
    patches = surface_patches(local, normal, area, pair, spacing, colour)
    return SurfaceIndex(
        centre, local.astype(np.float32), normal.astype(np.float32), normal.astype(np.float32), area,
        noise, spacing, colour, patches,
    )  # fmt: skip


def index_cloud(points: ArrayLike, colours: ArrayLike | None = None) -> SurfaceIndex:
    """Drain `index_cloud_job`."""
    return drain(index_cloud_job(points, colours))


def _check(points: FloatArray, colours: ArrayLike | None) -> None:
    if points.ndim != 2 or points.shape[1:] != (3,) or len(points) < _NEIGHBOURS:
        raise RegionError(
            f"The cloud has fewer than {_NEIGHBOURS} points: there is nothing to mark regions on."
        )
    if not np.all(np.isfinite(points)):
        raise RegionError("The cloud has coordinates that are not numbers: repair it first.")
    if colours is not None and np.asarray(colours).shape != points.shape:
        raise RegionError("The cloud's colours have to be red, green and blue of every point.")


def _planes(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Normals (n,3) and scatter across (n,), m, of planes through neighbourhoods (n,k,3)."""
    off = points - points.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", off, off) / points.shape[1])
    return vectors[:, :, 0], np.sqrt(np.maximum(values[:, 0], 0))


def _pairs(near: IndexArray) -> IntArray:
    """Distinct pairs (E,2) of neighbours: (N,k) -> (E,2)."""
    count = len(near)
    here = np.repeat(np.arange(count), near.shape[1])
    low, high = np.minimum(here, near.ravel()), np.maximum(here, near.ravel())
    key = np.unique(low * count + high)
    pairs: IntArray = np.stack([key // count, key % count], axis=1).astype(np.int32)
    distinct: IntArray = pairs[pairs[:, 0] != pairs[:, 1]]
    return distinct


def _signs(normal: FloatArray, pair: IntArray) -> FloatArray:
    """Sign (N,) for every normal, so that they agree along the spanning tree that turns least."""
    count = len(normal)
    cosine = np.einsum("nk,nk->n", normal[pair[:, 0]], normal[pair[:, 1]])
    label = labelled(pair[:, 0], pair[:, 1], count)
    roots = np.unique(label, return_index=True)[1]
    # One more node holds the pieces together.
    first = np.concatenate([pair[:, 0], np.full(len(roots), count)])
    second = np.concatenate([pair[:, 1], roots])
    weight = np.concatenate([1.001 - np.abs(cosine), np.ones(len(roots))])
    graph = coo_matrix((weight, (first, second)), shape=(count + 1, count + 1)).tocsr()
    parent = breadth_first_order(minimum_spanning_tree(graph), count, directed=False)[1]
    parent[count] = count
    above = parent[:count]
    turned = np.einsum("nk,nk->n", normal, normal[np.minimum(above, count - 1)]) < 0
    sign = np.append(np.where(turned & (above < count), -1.0, 1.0), 1.0)
    while np.any(parent != count):  # every round doubles the stretch of the tree that a sign stands for
        sign *= sign[parent]
        parent = parent[parent]
    return sign[:count]
