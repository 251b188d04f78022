"""A region picked on a point cloud: its outline as an alpha shape, triangulated for the solver."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from ...arrays import ArrayLike, BoolArray, FloatArray, IndexArray, IntArray
from ...errors import RegionError
from ...geometry.boundary import boundary_edges
from ..image_region import described
from ..surface_region import SurfaceRegion
from .graph import labelled
from .robust_fit import SurfaceFit, fit_smooth

_FEWEST = 20  # points that make an outline
_NEAR = 6  # neighbours whose distance is the local spacing
_ALPHA = 1.6  # largest circumradius in distances to the sixth neighbour: empty places wider than that are
_SPECK = 8  # triangles of a gap that is none
_SAME = 0.02  # distances to the next point within which a point is the same one
_NEARLY_ALL = 0.95
_LEAST = 0.6  # share of a region's points that has to be found again
_SAMPLE = 4000  # points that the fit looks at


def cloud_region(points: ArrayLike, name: str = "") -> SurfaceRegion:
    """Triangulated patch through the points (N,3), metres, of one region.

    The points are laid on the plane or quadric that fits them best, and triangulated there; triangles wider
    than the local spacing allows are gaps. The true outline runs outside the outermost points by half a
    spacing on average, and the patch is widened by that.

    Raises
    ------
    RegionError
        Too few points, coordinates that are no numbers, points in a row, or points too scattered for an
        outline.

    Source: Edelsbrunner, Kirkpatrick and Seidel, On the shape of a set of points in the plane, 1983, with the
    radius relative to the local spacing.
    """
    place = np.asarray(points, dtype=np.float64)
    if place.ndim != 2 or place.shape[1:] != (3,) or len(place) < _FEWEST:
        raise RegionError(
            f"{described(name)} has fewer than {_FEWEST} points: choose a larger part of the cloud."
        )
    if not np.all(np.isfinite(place)):
        raise RegionError(f"{described(name)} has coordinates that are not numbers: repair the cloud first.")
    origin = place.mean(axis=0)
    local = place - origin
    fit = fit_smooth(local[:: max(1, len(local) // _SAMPLE)])
    flat = (local - fit.centre) @ fit.axes[:2].T
    flat, faces = _alpha_shape(flat, name)
    flat = _widened(flat, faces)
    used, corners = np.unique(faces, return_inverse=True)
    return SurfaceRegion(origin + _lifted(flat[used], fit), corners.reshape(-1, 3), name)


def found_points(region: ArrayLike, points: ArrayLike, name: str = "") -> IndexArray:
    """Points (n,) of a cloud (N,3) that are those of a region (k,3), both metres; the cloud may have changed.

    The same points are taken when nearly all are there, else those nearer than the region's points are to
    each other.

    Raises
    ------
    RegionError
        Less than 60 % of the region is there.
    """
    known, place = np.asarray(region, dtype=np.float64), np.asarray(points, dtype=np.float64)
    centre = known.mean(axis=0)
    tree = cKDTree(known - centre)
    spacing = float(np.median(np.asarray(tree.query(known - centre, 2)[0])[:, 1]))
    low, high = known.min(axis=0) - spacing, known.max(axis=0) + spacing
    near = np.flatnonzero(np.all((place >= low) & (place <= high), axis=1))
    away, met = (np.asarray(some) for some in tree.query(place[near] - centre))
    for reach, least in ((_SAME * spacing, _NEARLY_ALL), (spacing, _LEAST)):
        inside = away <= reach
        share = len(np.unique(met[inside])) / len(known)
        if share >= least:
            return near[inside]
    raise RegionError(
        f"{described(name)} is not in this cloud: {100 * share:.0f} % of its points were found again. "
        "Mark it anew, or move the cloud to where it was."
    )


def _lifted(flat: FloatArray, fit: SurfaceFit) -> FloatArray:
    """Points (n,3) of a fit above places (n,2) of its plane."""
    base = fit.centre + flat @ fit.axes[:2]
    lifted: FloatArray = base - fit.distance(base)[:, None] * fit.normal
    return lifted


def _alpha_shape(flat: FloatArray, name: str) -> tuple[FloatArray, IndexArray]:
    """Points (n,2) without doubles, and the triangles (F,3) of their largest connected alpha shape."""
    spread = np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)
    if spread[1] < 1e-3 * spread[0]:
        raise RegionError(f"{described(name)} has its points in a row: choose a part of a surface.")
    grain = 1e-6 * float(np.ptp(flat, axis=0).max())
    flat = flat[np.sort(np.unique(np.round(flat / grain), axis=0, return_index=True)[1])]
    if len(flat) < _FEWEST:
        raise RegionError(f"{described(name)} has too few different points for an outline.")
    whole = Delaunay(flat)
    faces: IndexArray = whole.simplices.astype(np.int64)
    reach = np.asarray(cKDTree(flat).query(flat, _NEAR + 1)[0])[:, -1]
    kept = _circumradius(flat[faces]) <= _ALPHA * reach[faces].max(axis=1)
    faces = faces[kept | _specks(~kept, whole.neighbors)]
    faces = _largest_piece(flat, _wound(flat, faces))
    if len(np.unique(faces)) < 0.5 * len(flat):
        raise RegionError(
            f"{described(name)} is scattered in pieces: choose points of one surface that hang together."
        )
    return flat, faces


def _specks(gap: BoolArray, neighbours: IntArray) -> BoolArray:
    """Which triangles (F,) lie in gaps of a few: chance leaves such between scattered points."""
    here = np.repeat(np.arange(len(gap)), 3)
    there = neighbours.ravel()
    both = (there >= 0) & gap[here] & gap[there]
    label = labelled(here[both], there[both], len(gap))
    size = np.bincount(label)
    size[label[np.any(neighbours < 0, axis=1)]] = len(gap)  # open to the outside
    speck: BoolArray = gap & (size[label] <= _SPECK)
    return speck


def _circumradius(corners: FloatArray) -> FloatArray:
    """Radius (n,) of the circles through triangles (n,3,2)."""
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    double = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    radius: FloatArray = sides.prod(axis=1) / np.maximum(2 * double, 1e-300)
    return radius


def _wound(flat: FloatArray, faces: IndexArray) -> IndexArray:
    """Triangles (F,3) all wound alike: anticlockwise about the fit's normal."""
    first, second = flat[faces[:, 1]] - flat[faces[:, 0]], flat[faces[:, 2]] - flat[faces[:, 0]]
    clockwise = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] < 0
    return np.where(clockwise[:, None], faces[:, ::-1], faces)


def _largest_piece(flat: FloatArray, faces: IndexArray) -> IndexArray:
    """Triangles of the piece with most of them, joined through corners."""
    if len(faces) == 0:
        return faces
    label = labelled(
        np.concatenate([faces[:, 0], faces[:, 1]]), np.concatenate([faces[:, 1], faces[:, 2]]), len(flat)
    )
    piece = label[faces[:, 0]]
    kept: BoolArray = piece == np.argmax(np.bincount(piece))
    return faces[kept]


def _widened(flat: FloatArray, faces: IndexArray) -> FloatArray:
    """Points (n,2) with those of the boundary moved outwards by half a spacing.

    A triangulation of n points with b on its boundary has about 2 n - b triangles where the whole area would
    have 2 n: what is missing, spread over the boundary's length, is the step outwards.
    """
    edges = boundary_edges(faces)
    along = flat[edges[:, 1]] - flat[edges[:, 0]]
    length = np.linalg.norm(along, axis=1)
    first, second = flat[faces[:, 1]] - flat[faces[:, 0]], flat[faces[:, 2]] - flat[faces[:, 0]]
    beside = np.any(np.isin(faces, edges[:, 0]), axis=1)  # spacing may differ inside
    mean = 0.5 * float(np.mean(np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])[beside]))
    step = len(edges) * mean / float(length.sum())
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1)  # the surface lies left of its boundary
    push = np.zeros_like(flat)
    np.add.at(push, edges[:, 0], outward)
    np.add.at(push, edges[:, 1], outward)
    size = np.linalg.norm(push, axis=1, keepdims=True)
    widened: FloatArray = flat + step * push / np.where(size > 0, size, 1.0)
    return widened
