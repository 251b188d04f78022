"""A scan made ready for clicks: neighbours, smoothed normals, patches, and how noisy the scan is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from ...arrays import AnyArray, ArrayLike, Float32Array, FloatArray, IndexArray, IntArray
from ...errors import RegionError
from ...geometry.meshes import edge_pairs, face_normals
from ...geometry.rays import local_centre
from ...jobs import Job, Progress, drain
from .graph import from_neighbours
from .patches import SurfacePatches, surface_patches

_SMOOTHING_ROUNDS = 4
_MORE_ROUNDS = 8  # at most, on rough scans
_JOINED = 0.5  # neighbours per face below which a scan counts as loose triangles


@dataclass(frozen=True, eq=False)
class SurfaceIndex:
    """What the surface wand knows of a scan; see `index_surface`.

    `centre` (3,) m is the origin of `middle` (F,3), the faces' centroids; `normal` (F,3) unit,
    `smooth_normal` (F,3) the same averaged over neighbours; `area` (F,) m²; `pair` (E,2) neighbouring faces;
    `noise` m the scan's own roughness; `spacing` m the median distance of neighbouring centroids; `colour`
    (F,3) CIELAB or None.
    """

    centre: FloatArray
    middle: Float32Array
    normal: Float32Array
    smooth_normal: Float32Array
    area: FloatArray
    noise: float
    spacing: float
    colour: Float32Array | None
    patches: SurfacePatches

    @property
    def face_count(self) -> int:
        """Number of faces of the scan."""
        return len(self.area)

    @cached_property
    def colour_noise(self) -> float:
        """Usual difference of neighbouring patches, Delta E."""
        patches = self.patches
        if patches.colour is None or len(patches.pair) == 0:
            return 0.0
        first, second = patches.pair.T
        return float(np.median(np.linalg.norm(patches.colour[first] - patches.colour[second], axis=1)))

    @property
    def pair(self) -> IntArray:
        """Neighbouring faces (E,2)."""
        return self.patches.near


def index_surface_job(
    vertices: ArrayLike, faces: ArrayLike, colours: ArrayLike | None = None
) -> Job[SurfaceIndex]:
    """Make a scan ready for the surface wand: (V,3) m, (F,3), optional colours per vertex (V,3) uint8 sRGB.

    Works on any triangles: non-manifold edges join all their faces; loose triangles (STL) are joined where
    their corners coincide. Brightness from a scanner's intensity may be given as grey colours.

    Raises
    ------
    RegionError
        No faces, coordinates that are no numbers, or colours that do not fit the vertices.
    """
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces)
    _check(points, triangles, colours)
    yield Progress(0.0, "Reading the surface")
    centre = local_centre(points[np.unique(triangles)])
    local = points - centre
    normal, area = face_normals(local, triangles)
    middle = local[triangles].mean(axis=1)
    yield Progress(0.2, "Finding neighbours")
    pair = _neighbours(local, triangles)
    yield Progress(0.4, "Smoothing normals")
    smooth = normal
    for number in range(_SMOOTHING_ROUNDS):
        smooth = _smoothed(smooth, area, pair)
        yield Progress(0.4 + 0.05 * number, "Smoothing normals")
    noise, spacing = _noise(local, triangles, middle, smooth, pair)
    smoother = smooth
    # Averaging over n faces takes the root of n off the noise of their normals.
    for number in range(min(round(20 * noise / max(spacing, 1e-9)), _MORE_ROUNDS)):
        smoother = _smoothed(smoother, area, pair)
        yield Progress(0.6 + 0.02 * number, "Smoothing normals")
    colour = None
    if colours is not None:
        colour = byte_colours(np.asarray(colours, dtype=np.uint8)[triangles].mean(axis=1))
    yield Progress(0.8, "Joining faces to patches")
    patches = surface_patches(middle, smoother, area, pair, spacing, colour)
    return SurfaceIndex(
        centre, middle.astype(np.float32), normal.astype(np.float32), smooth.astype(np.float32), area,
        noise, spacing, colour, patches,
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


def _neighbours(points: FloatArray, triangles: IndexArray) -> IntArray:
    """Neighbouring faces (E,2); where hardly any share an edge, corners at the same place count as one."""
    pair = edge_pairs(triangles, len(points)).face
    if len(pair) >= _JOINED * len(triangles):
        return pair
    place = np.ascontiguousarray(points + 0.0).view(np.dtype((np.void, 24))).ravel()
    first, welded = np.unique(place, return_index=True, return_inverse=True)[1:]
    return edge_pairs(welded.reshape(-1)[triangles], len(first)).face


def _smoothed(normal: FloatArray, area: FloatArray, pair: IntArray) -> FloatArray:
    """Normals (F,3) averaged with those neighbours that turn less than about 60 degrees.

    Creases stay sharp; a face without area takes the normal of its neighbours.
    """
    cosine = np.einsum("nk,nk->n", normal[pair[:, 0]], normal[pair[:, 1]])
    weight = np.clip(2 * cosine - 1, 0, 1) ** 2
    flat = ~np.any(normal, axis=1)
    weight[flat[pair[:, 0]] | flat[pair[:, 1]]] = 1.0
    weighted = normal * area[:, None]
    smooth = weighted + from_neighbours(weighted, pair, weight)
    smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-300)
    return smooth


def _noise(
    local: FloatArray, triangles: IndexArray, middle: FloatArray, smooth: FloatArray, pair: IntArray
) -> tuple[float, float]:
    """Roughness of the smoothest half of the scan, and the median distance between neighbouring centroids, m.

    Every face's middle is measured against the mean of its neighbours along the smoothed normal. For
    independent vertex noise s that difference has variance s² (1/3 + 1/3) / (about 3); the factor is
    calibrated on triangulated noisy planes. Relief raises the difference, so the lower half of the scan
    decides.
    """
    if len(pair) == 0:
        return 0.0, float(np.median(np.ptp(local[triangles], axis=1).max(axis=1)))
    count = np.bincount(pair.ravel(), minlength=len(middle))
    mean = from_neighbours(middle, pair) / np.maximum(count, 1)[:, None]
    off = np.abs(np.sum((middle - mean) * smooth, axis=1))[count == 3]
    spacing = float(np.median(np.linalg.norm(middle[pair[:, 0]] - middle[pair[:, 1]], axis=1)))
    if len(off) == 0:
        return 0.0, spacing
    # The median of |N(0, s)| is 0.674 s; the lower half's median (first quartile) 0.319 s.
    return float(np.quantile(off, 0.25)) / 0.319 * _NOISE_FACTOR, spacing


_NOISE_FACTOR = 3.66
"""Vertex noise per scatter of a face's middle against its three neighbours' (measured on noisy planes)."""


def byte_colours(colours: AnyArray) -> Float32Array:
    """CIELAB (N,3) of sRGB colours (N,3) from 0 to 255."""
    rgb = np.asarray(colours, dtype=np.float32) / 255
    values: Float32Array = cv2.cvtColor(rgb[None], cv2.COLOR_RGB2LAB)[0].astype(np.float32)
    return values
