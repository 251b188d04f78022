"""The geometric stage: projected surface boundary against the photo's outline, in pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import BoolArray, FloatArray, IndexArray
from ...cameras.base import Camera
from ...geometry.contours import resampled, smoothed
from ...geometry.rigid import exp_so3

MOST_POINTS = 20_000  # samples of a boundary that comes absurdly near to the camera
SAMPLES = 400  # boundary samples per region


@dataclass(frozen=True, eq=False)
class ImageContour:
    """Smoothed outline of the photo's region: points (n,2) px, outward normals (n,2), weights (n,) 0 or 1."""

    points: FloatArray
    normals: FloatArray
    weights: FloatArray
    tree: cKDTree


@dataclass(frozen=True, eq=False)
class SurfaceContour:
    """Smoothed boundary of surface regions: points (m from the origin), unit tangents (n,3) as of an outline.

    `block` (n,) numbers stretches of the boundary whose errors hang together; `spacing` is about how far
    (px) samples are apart; `front` says that the camera sees the side that all regions' faces are wound for.
    """

    points: FloatArray
    tangents: FloatArray
    block: IndexArray
    spacing: int
    front: bool


@dataclass(frozen=True, eq=False)
class ContourPair:
    """Outline and boundary that should coincide; `alike` is the least cosine of normals that match."""

    image: ImageContour
    surface: SurfaceContour
    alike: float


@dataclass(frozen=True, eq=False)
class LensStep:
    """A free parameter of the lens: the camera with it raised and lowered, and how far apart these are."""

    plus: Camera
    minus: Camera
    width: float


@dataclass(frozen=True, eq=False)
class Match:
    """Per boundary sample: signed distance to the outline (px, NaN if none belongs), its derivative (n,P).

    P parameters: turn about the origin, shift, and the free ones of the lens.
    """

    distances: FloatArray
    jacobian: FloatArray
    nearest: IndexArray


def image_contour(loops: Sequence[FloatArray], hidden: BoolArray | None, half_width: int) -> ImageContour:
    """Smooth outlines (n,2) of pixel coordinates; where `hidden` (H,W) is near, they do not count."""
    points, normals = [], []
    for loop in loops:
        step = np.abs(np.roll(loop, -1, axis=0) - loop).sum(axis=1)
        curve = smoothed(loop if np.all(step == 1.0) else resampled(loop, 1.0), half_width)
        points.append(curve.points)
        normals.append(np.stack([curve.tangents[:, 1], -curve.tangents[:, 0]], axis=1))
    everything, outwards = np.concatenate(points), np.concatenate(normals)
    weights = shown(everything, outwards, hidden).astype(np.float64)
    return ImageContour(everything, outwards, weights, cKDTree(everything))


def shown(points: FloatArray, outwards: FloatArray, hidden: BoolArray | None) -> BoolArray:
    """Which points (n,2) px of an outline with outward normals (n,2) have nothing `hidden` (H,W) beside."""
    seen = np.ones(len(points), dtype=bool)
    if hidden is not None:
        for reach in (-3.0, -1.5, 0.0, 1.5, 3.0):
            u, v = np.rint(points + reach * outwards).astype(np.int64).T
            seen &= ~hidden[np.clip(v, 0, hidden.shape[0] - 1), np.clip(u, 0, hidden.shape[1] - 1)]
    return seen


def surface_contour(
    camera: Camera,
    regions: Sequence[Sequence[FloatArray]],
    rotation: FloatArray,
    translation: FloatArray,
    half_width: int,
    block: int,
) -> SurfaceContour:
    """Sample boundary loops (n,3) one pixel of this pose apart, smooth them as outlines are, thin out."""
    points, tangents, blocks, turns = [], [], [], []
    count = 0
    for loops in regions:
        size = metres_per_pixel(camera, loops, rotation, translation)
        turns.append(area_turn(loops, rotation, translation))
        for loop in loops:
            curve = smoothed(resampled(loop, size), half_width)
            points.append(curve.points)
            tangents.append(turns[-1] * curve.tangents)
            blocks.append(count + np.arange(len(curve.points)) // block)
            count = int(blocks[-1][-1]) + 1
    stride = max(1, sum(map(len, points)) // (SAMPLES * len(regions)))
    return SurfaceContour(
        np.concatenate(points)[::stride],
        np.concatenate(tangents)[::stride],
        np.concatenate(blocks)[::stride],
        stride,
        all(turn < 0 for turn in turns),
    )


def outward(jacobian: FloatArray, tangents: FloatArray) -> FloatArray:
    """Outward unit normals (n,2) in the photo of a boundary with tangents (n,3) in the camera frame."""
    direction = np.einsum("nij,nj->ni", jacobian, tangents)
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-300)
    return np.stack([direction[:, 1], -direction[:, 0]], axis=1)


def match(
    camera: Camera,
    pair: ContourPair,
    rotation: FloatArray,
    translation: FloatArray,
    lens: Sequence[LensStep] = (),
) -> Match:
    """Distance of every projected boundary sample from the outline's nearest piece, along its normal."""
    turned = pair.surface.points @ rotation.T
    pixels, jacobian = camera.project_with_jacobian(turned + translation)
    seen = np.all(np.isfinite(pixels), axis=1)
    nearest = np.asarray(pair.image.tree.query(np.where(seen[:, None], pixels, 0.0))[1], dtype=np.int64)
    normals = pair.image.normals[nearest]
    distances = np.sum(normals * (pixels - pair.image.points[nearest]), axis=1)
    across = np.einsum("ni,nij->nj", normals, jacobian)
    free = [_lens_slope(step, turned + translation, normals) for step in lens]
    slope = np.concatenate([np.cross(turned, across), across, *free], axis=1)
    drawn = outward(jacobian, pair.surface.tangents @ rotation.T)
    alike = np.sum(drawn * normals, axis=1) > pair.alike
    usable = seen & alike & (pair.image.weights[nearest] > 0)
    return Match(np.where(usable, distances, np.nan), np.where(usable[:, None], slope, 0.0), nearest)


def _lens_slope(step: LensStep, points: FloatArray, normals: FloatArray) -> FloatArray:
    """Movement (n,1) of projected points across the outline per unit of a lens parameter."""
    moved = (step.plus.project(points) - step.minus.project(points)) / step.width
    slope: FloatArray = np.sum(normals * moved, axis=1, keepdims=True)
    return slope


def refine_by_contours(
    camera: Camera,
    pairs: Sequence[ContourPair],
    rotation: FloatArray,
    translation: FloatArray,
    scales: Sequence[float],
) -> tuple[FloatArray, FloatArray]:
    """Gauss-Newton, one step per scale (px)."""
    for scale in scales:
        step = gauss_newton_step([match(camera, pair, rotation, translation) for pair in pairs], scale)
        rotation, translation = exp_so3(step[:3]) @ rotation, translation + step[3:]
    return rotation, translation


def gauss_newton_step(matches: Sequence[Match], scale: float) -> FloatArray:
    """Step (P,) that lessens the distances, with Geman-McClure weights at `scale` px."""
    size = matches[0].jacobian.shape[1]
    normal, gradient = np.zeros((size, size)), np.zeros(size)
    for found in matches:
        weighted = found.jacobian * robust_weights(found.distances, scale)[:, None]
        normal += weighted.T @ found.jacobian
        gradient += weighted.T @ np.nan_to_num(found.distances)
    damped = normal + np.diag(1e-6 * np.diag(normal) + 1e-12)
    step: FloatArray = -np.linalg.solve(damped, gradient)
    return step


def area_turn(loops: Sequence[FloatArray], rotation: FloatArray, translation: FloatArray) -> float:
    """1 where the longest loop's area vector points away from the camera, as an outline's does; else -1."""
    loop = max(loops, key=_length)
    area = np.cross(loop - loop[0], np.roll(loop, -1, axis=0) - loop[0]).sum(axis=0)
    return float(np.sign((rotation @ area) @ (rotation @ loop.mean(axis=0) + translation))) or 1.0


def metres_per_pixel(
    camera: Camera, loops: Sequence[FloatArray], rotation: FloatArray, translation: FloatArray
) -> float:
    """Median length on the surface of a pixel along the boundary; not less than keeps sampling in bounds.

    A boundary that is nowhere in view is sampled sparsely.
    """
    points = np.concatenate([resampled(loop, _length(loop) / 64) for loop in loops])
    pixels = camera.project(points @ rotation.T + translation)
    steps = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    drawn = np.linalg.norm(np.roll(pixels, -1, axis=0) - pixels, axis=1)
    finest = sum(map(_length, loops)) / MOST_POINTS
    seen = np.isfinite(drawn) & (drawn > 0)
    return max(float(np.median(steps[seen] / drawn[seen])), finest) if seen.any() else 100.0 * finest


def robust_weights(distances: FloatArray, scale: float) -> FloatArray:
    """Geman-McClure weights `1 / (1 + (r/s)²)²` (n,) of distances (px), zero for those that are NaN."""
    return np.where(np.isfinite(distances), 1.0 / (1.0 + (np.nan_to_num(distances) / scale) ** 2) ** 2, 0.0)


def _length(loop: FloatArray) -> float:
    return float(np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1).sum())


def lock_ratio(distances: FloatArray, near: float) -> float:
    """Density of distances below `near` px over that up to five times as far; high in the right place."""
    size = np.abs(distances)
    inside = np.count_nonzero(size < near)
    outside = np.count_nonzero((size >= near) & (size < 5 * near))
    return 4.0 * inside / max(outside, 4.0)
