"""A scan made ready for clicks: neighbours, smoothed normals, and how noisy the scan is."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..arrays import AnyArray, ArrayLike, BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from ..errors import RegionError
from ..geometry.meshes import edge_pairs, face_normals
from ..geometry.rays import local_centre
from ..jobs import Job, Progress, drain

_SMOOTHING_ROUNDS = 4
_ONE_COLOUR = 8.0  # Delta E below which neighbouring faces may be one patch


@dataclass(frozen=True, eq=False)
class SurfacePatches:
    """Small flat pieces of a scan, about `2 * spacing` wide: growing looks at them first, at faces last.

    `label` (F,) is the patch of every face; `middle` (P,3) m and `normal` (P,3) unit their means; `area`
    (P,) m²;
    `pair` (Q,2) neighbours; `rim` (P,) true where the scan ends or has a hole; `colour` (P,3) CIELAB or None.
    """

    label: IntArray
    middle: FloatArray
    normal: FloatArray
    area: FloatArray
    pair: IntArray
    rim: BoolArray
    colour: FloatArray | None
    tree: cKDTree


@dataclass(frozen=True, eq=False)
class SurfaceIndex:
    """What the surface wand knows of a scan; see `index_surface`.

    `centre` (3,) m is the origin of `middle` (F,3), the faces' centroids; `normal` (F,3) unit,
    `smooth_normal` (F,3) the
    same averaged over neighbours; `area` (F,) m²; `pair` (E,2) neighbouring faces; `noise` m the scan's own
    roughness;
    `spacing` m the median distance of neighbouring centroids; `colour` (F,3) CIELAB or None; `colour_noise`
    Delta E.
    """

    centre: FloatArray
    middle: Float32Array
    normal: Float32Array
    smooth_normal: Float32Array
    area: FloatArray
    pair: IntArray
    noise: float
    spacing: float
    colour: Float32Array | None
    colour_noise: float
    patches: SurfacePatches

    @property
    def face_count(self) -> int:
        """Number of faces of the scan."""
        return len(self.area)


def reduced_pairs(pair: IntArray, inside: BoolArray) -> tuple[IntArray, IntArray]:
    """Pairs between marked nodes, numbered among these.

    Pairs (E,2), inside (N,) -> members (n,), pairs (m,2).
    """
    members = np.flatnonzero(inside).astype(np.int32)
    number = np.cumsum(inside, dtype=np.int32) - 1
    kept = pair[inside[pair[:, 0]] & inside[pair[:, 1]]]
    return members, number[kept].astype(np.int32)


def component(pair: IntArray, inside: BoolArray, start: int) -> IndexArray:
    """Nodes (n,) joined to node `start` through marked ones (N,), sorted."""
    members, pairs = reduced_pairs(pair, inside)
    label = labelled(pairs[:, 0], pairs[:, 1], len(members))
    joined: IndexArray = members[label == label[np.searchsorted(members, start)]].astype(np.int64)
    return joined


def labelled(first: ArrayLike, second: ArrayLike, count: int) -> IntArray:
    """Component number (count,) of a graph with edges first[i] - second[i]."""
    edges = np.asarray(first), np.asarray(second)
    graph = coo_matrix((np.ones(len(edges[0]), dtype=np.int8), edges), shape=(count, count))
    label: IntArray = connected_components(graph, directed=False)[1]
    return label


def index_surface_job(
    vertices: ArrayLike, faces: ArrayLike, colours: ArrayLike | None = None
) -> Job[SurfaceIndex]:
    """Make a scan ready for the surface wand: (V,3) m, (F,3), optional colours per vertex (V,3) uint8 sRGB.

    Works on any triangles: non-manifold edges join all their faces, loose triangles have no neighbours.

    Raises
    ------
    RegionError
        No faces, coordinates that are no numbers, or colours that do not fit the vertices.
    """
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces)
    _check(points, triangles, colours)
    yield Progress(0.0, "Reading the surface")
    centre = local_centre(points)
    local = points - centre
    normal, area = face_normals(local, triangles)
    middle = local[triangles].mean(axis=1)
    yield Progress(0.2, "Finding neighbours")
    pairs = edge_pairs(triangles, len(points))
    yield Progress(0.5, "Smoothing normals")
    smooth = normal
    for number in range(_SMOOTHING_ROUNDS):
        smooth = _smoothed(smooth, area, pairs.face)
        yield Progress(0.5 + 0.05 * number, "Smoothing normals")
    yield Progress(0.8, "Measuring the scan's noise")
    noise, spacing = _noise(local, triangles, middle, smooth, pairs.face)
    colour, colour_noise = _colours(colours, triangles, pairs.face)
    yield Progress(0.85, "Joining faces to patches")
    patches = _patches(middle, smooth, area, pairs.face, 2 * spacing, colour)
    return SurfaceIndex(
        centre, middle.astype(np.float32), normal.astype(np.float32), smooth.astype(np.float32), area,
        pairs.face, noise, spacing, colour, colour_noise, patches,
    )  # fmt: skip


def index_surface(vertices: ArrayLike, faces: ArrayLike, colours: ArrayLike | None = None) -> SurfaceIndex:
    """Drain `index_surface_job`."""
    return drain(index_surface_job(vertices, faces, colours))


def _check(points: FloatArray, triangles: IndexArray, colours: ArrayLike | None) -> None:
    if triangles.ndim != 2 or triangles.shape[1:] != (3,) or len(triangles) == 0:
        raise RegionError("The scan has no triangles to mark regions on.")
    if not np.all(np.isfinite(points[triangles.ravel()])):
        raise RegionError("The scan has coordinates that are not numbers: repair it first.")
    if colours is not None and np.asarray(colours).shape != (len(points), 3):
        raise RegionError("The scan's colours have to be red, green and blue of every vertex.")


def _smoothed(normal: FloatArray, area: FloatArray, pair: IntArray) -> FloatArray:
    """Normals (F,3) averaged with those neighbours that turn less than about 60 degrees.

    Creases stay sharp.
    """
    cosine = np.einsum("nk,nk->n", normal[pair[:, 0]], normal[pair[:, 1]])
    smooth = normal * area[:, None]
    smooth += _from_neighbours(normal * area[:, None], pair, np.clip(2 * cosine - 1, 0, 1) ** 2)
    smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-300)
    return smooth


def _from_neighbours(values: FloatArray, pair: IntArray, weight: FloatArray | float = 1.0) -> FloatArray:
    """Sum (F,k) of the neighbours' values, each pair (E,2) with a weight (E,)."""
    total = np.empty_like(values)
    for axis in range(values.shape[1]):
        total[:, axis] = np.bincount(pair[:, 0], weight * values[pair[:, 1], axis], minlength=len(values))
        total[:, axis] += np.bincount(pair[:, 1], weight * values[pair[:, 0], axis], minlength=len(values))
    return total


def _noise(
    local: FloatArray, triangles: IndexArray, middle: FloatArray, smooth: FloatArray, pair: IntArray
) -> tuple[float, float]:
    """Roughness of the smoothest half of the scan, and the median distance between neighbouring centroids, m.

    Every face's middle is measured against the mean of its neighbours along the smoothed normal. For
    independent vertex noise s that difference has variance s² (1/3 + 1/3)/ (about 3); the factor is
    calibrated on triangulated noisy planes. Relief raises the difference, so the lower half of the scan
    decides.
    """
    if len(pair) == 0:
        return 0.0, float(np.median(np.ptp(local[triangles], axis=1).max(axis=1)))
    count = np.bincount(pair.ravel(), minlength=len(middle))
    mean = _from_neighbours(middle, pair) / np.maximum(count, 1)[:, None]
    off = np.abs(np.sum((middle - mean) * smooth, axis=1))[count == 3]
    spacing = float(np.median(np.linalg.norm(middle[pair[:, 0]] - middle[pair[:, 1]], axis=1)))
    if len(off) == 0:
        return 0.0, spacing
    # The median of |N(0, s)| is 0.674 s; the lower half's median (first quartile) 0.319 s.
    return float(np.quantile(off, 0.25)) / 0.319 * _NOISE_FACTOR, spacing


_NOISE_FACTOR = 3.66
"""Vertex noise per scatter.

Of a face's middle against its three neighbours' (measured on noisy triangulated planes).
"""


def _patches(
    middle: FloatArray,
    smooth: FloatArray,
    area: FloatArray,
    pair: IntArray,
    size: float,
    colour: Float32Array | None,
) -> SurfacePatches:
    """Join neighbouring faces of one voxel whose smoothed normals differ by less than 30 degrees."""
    cell = np.floor((middle - middle.min(axis=0)) / max(size, 1e-9)).astype(np.int64)
    key = (cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1]) * (cell[:, 2].max() + 1) + cell[:, 2]
    alike = key[pair[:, 0]] == key[pair[:, 1]]
    alike &= np.einsum("nk,nk->n", smooth[pair[:, 0]], smooth[pair[:, 1]]) > np.cos(np.radians(30))
    if colour is not None:
        alike &= np.linalg.norm(colour[pair[:, 0]] - colour[pair[:, 1]], axis=1) < _ONE_COLOUR
    label = labelled(pair[alike, 0], pair[alike, 1], len(middle))
    count = int(label.max()) + 1
    weight = np.maximum(area, 1e-12 * max(float(area.max()), 1e-300))
    total = np.bincount(label, weight, minlength=count).astype(np.float64)
    normal = _mean(label, weight, smooth, total)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    across = np.sort(label[pair[~alike]], axis=1).astype(np.int64)
    joint = np.unique(across[:, 0] * count + across[:, 1])
    neighbours = np.stack([joint // count, joint % count], axis=1).astype(np.int32)
    rim = np.bincount(label, np.bincount(pair.ravel(), minlength=len(middle)) < 3, minlength=count) > 0
    place = _mean(label, weight, middle, total)
    tint = None if colour is None else _mean(label, weight, colour, total)
    return SurfacePatches(label, place, normal, total, neighbours[neighbours[:, 0] != neighbours[:, 1]],
    rim, tint,
                          cKDTree(place))  # fmt: skip


def _mean(label: IntArray, weight: FloatArray, values: AnyArray, total: FloatArray) -> FloatArray:
    """Weighted means (P,k) of the faces' values (F,k) per patch."""
    sums = [np.bincount(label, weight * values[:, k], minlength=len(total)) for k in range(values.shape[1])]
    mean: FloatArray = np.stack(sums, axis=1) / total[:, None]
    return mean


def _colours(
    colours: ArrayLike | None, triangles: IndexArray, pair: IntArray
) -> tuple[Float32Array | None, float]:
    """CIELAB (F,3) of faces and the usual difference of neighbours, Delta E."""
    if colours is None:
        return None, 0.0
    rgb = np.asarray(colours, dtype=np.uint8)[triangles].mean(axis=1).astype(np.float32) / 255
    values = cv2.cvtColor(rgb[None], cv2.COLOR_RGB2LAB)[0].astype(np.float32)
    if len(pair) == 0:
        return values, 1.0
    difference = np.linalg.norm(values[pair[:, 0]] - values[pair[:, 1]], axis=1)
    return values, max(1.0, float(np.median(difference)))
