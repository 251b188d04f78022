"""The geometric stage: projected surface boundary against the photo's outline, in pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import FloatArray, IndexArray
from ...cameras.base import Camera
from ...geometry.contours import resampled, smoothed
from ...geometry.rigid import exp_so3

HALF_WIDTH = 7  # samples, about a pixel apart, on either side of a local fit
STRAIGHT = 0.45  # pixels of misfit that a straight or gently curved pixel outline stays below
ALIKE = 0.85  # cosine between normals of outline and projected boundary that belong together
SAMPLES = 360  # boundary samples per region


@dataclass(frozen=True, eq=False)
class ImageContour:
    """Smoothed outline of the photo's region: points (n,2) px, outward normals (n,2), weights (n,) 0 or 1."""

    points: FloatArray
    normals: FloatArray
    weights: FloatArray
    tree: cKDTree


@dataclass(frozen=True, eq=False)
class SurfaceContour:
    """Smoothed boundary of a surface region: points (m from origin), unit tangents (n,3), weights (n,)."""

    points: FloatArray
    tangents: FloatArray
    weights: FloatArray


@dataclass(frozen=True, eq=False)
class ContourPair:
    """Outline and boundary that should coincide in the photo."""

    image: ImageContour
    surface: SurfaceContour


@dataclass(frozen=True, eq=False)
class Match:
    """Per boundary sample: signed distance to the outline (px, NaN if none belongs), its derivative (n,6)."""

    distances: FloatArray
    jacobian: FloatArray
    nearest: IndexArray


def image_contour(loops: Sequence[FloatArray]) -> ImageContour:
    """Smooth outlines (n,2) of pixel coordinates."""
    points, normals, weights = [], [], []
    for loop in loops:
        step = np.abs(np.roll(loop, -1, axis=0) - loop).sum(axis=1)
        curve = smoothed(loop if np.all(step == 1.0) else resampled(loop, 1.0), HALF_WIDTH)
        points.append(curve.points)
        normals.append(np.stack([curve.tangents[:, 1], -curve.tangents[:, 0]], axis=1))
        weights.append((curve.misfits < STRAIGHT).astype(np.float64))
    everything = np.concatenate(points)
    return ImageContour(everything, np.concatenate(normals), np.concatenate(weights), cKDTree(everything))


def surface_contour(loops: Sequence[FloatArray], metres_per_pixel: float) -> SurfaceContour:
    """Sample boundary loops (n,3) one pixel apart, smooth them as the outline is, and thin them out."""
    points, tangents, weights = [], [], []
    for loop in loops:
        curve = smoothed(resampled(loop, metres_per_pixel), HALF_WIDTH)
        points.append(curve.points)
        tangents.append(curve.tangents)
        weights.append((curve.misfits < STRAIGHT * metres_per_pixel).astype(np.float64))
    stride = max(1, sum(map(len, points)) // SAMPLES)
    return SurfaceContour(
        np.concatenate(points)[::stride],
        np.concatenate(tangents)[::stride],
        np.concatenate(weights)[::stride],
    )


def match(camera: Camera, pair: ContourPair, rotation: FloatArray, translation: FloatArray) -> Match:
    """Distance of every projected boundary sample from the outline's nearest piece, along its normal."""
    turned = pair.surface.points @ rotation.T
    pixels, jacobian = camera.project_with_jacobian(turned + translation)
    seen = np.all(np.isfinite(pixels), axis=1)
    nearest = np.asarray(pair.image.tree.query(np.where(seen[:, None], pixels, 0.0))[1], dtype=np.int64)
    normals = pair.image.normals[nearest]
    distances = np.sum(normals * (pixels - pair.image.points[nearest]), axis=1)
    across = np.einsum("ni,nij->nj", normals, jacobian)
    slope = np.concatenate([np.cross(turned, across), across], axis=1)
    direction = np.einsum("nij,nj->ni", jacobian, pair.surface.tangents @ rotation.T)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    alike = np.abs(direction[:, 1] * normals[:, 0] - direction[:, 0] * normals[:, 1]) > ALIKE
    usable = seen & alike & (pair.image.weights[nearest] * pair.surface.weights > 0)
    return Match(np.where(usable, distances, np.nan), np.where(usable[:, None], slope, 0.0), nearest)


def refine_by_contours(
    camera: Camera,
    pairs: Sequence[ContourPair],
    rotation: FloatArray,
    translation: FloatArray,
    scales: Sequence[float],
) -> tuple[FloatArray, FloatArray]:
    """Gauss-Newton, one step per scale s (px), with Geman-McClure weights `1 / (1 + (r/s)²)²`."""
    for scale in scales:
        normal, gradient = np.zeros((6, 6)), np.zeros(6)
        for pair in pairs:
            found = match(camera, pair, rotation, translation)
            distances = np.nan_to_num(found.distances)
            weights = np.where(np.isfinite(found.distances), 1.0 / (1.0 + (distances / scale) ** 2) ** 2, 0.0)
            weighted = found.jacobian * weights[:, None]
            normal += weighted.T @ found.jacobian
            gradient += weighted.T @ distances
        diagonal = np.diag(normal)
        step = -np.linalg.solve(normal + np.diag(1e-6 * diagonal + 1e-12), gradient)
        rotation, translation = exp_so3(step[:3]) @ rotation, translation + step[3:]
    return rotation, translation


def contour_pairs(
    camera: Camera,
    pixel_loops: Sequence[Sequence[FloatArray]],
    surface_loops: Sequence[Sequence[FloatArray]],
    rotation: FloatArray,
    translation: FloatArray,
) -> list[ContourPair]:
    """Outlines and boundaries of every pair, the boundaries sampled one pixel apart at this pose."""
    pairs = []
    for outlines, boundaries in zip(pixel_loops, surface_loops, strict=True):
        size = _metres_per_pixel(camera, boundaries, rotation, translation)
        pairs.append(ContourPair(image_contour(outlines), surface_contour(boundaries, size)))
    return pairs


def _metres_per_pixel(
    camera: Camera, loops: Sequence[FloatArray], rotation: FloatArray, translation: FloatArray
) -> float:
    """Mean length on the surface of a pixel along the boundary."""
    points = np.concatenate([resampled(loop, _length(loop) / 64) for loop in loops])
    pixels = camera.project(points @ rotation.T + translation)
    steps = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    drawn = np.linalg.norm(np.roll(pixels, -1, axis=0) - pixels, axis=1)
    return float(1.0 / np.nanmedian(drawn / np.maximum(steps, 1e-300)))


def _length(loop: FloatArray) -> float:
    return float(np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1).sum())


def distances_of(
    camera: Camera, pairs: Sequence[ContourPair], rotation: FloatArray, translation: FloatArray
) -> FloatArray:
    """Distances (px) of all boundary samples, NaN where no outline belongs."""
    return np.concatenate([match(camera, pair, rotation, translation).distances for pair in pairs])


def lock_ratio(distances: FloatArray) -> float:
    """Density of distances within 0.7 px over that from 0.7 to 3.5 px: high where outlines coincide."""
    size = np.abs(distances)
    near = np.count_nonzero(size < 0.7) / 0.7
    far = np.count_nonzero((size >= 0.7) & (size < 3.5)) / 2.8
    return near / max(far, 1.0)
