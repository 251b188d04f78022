"""How good the marked regions are, and how sure a pose from them will be: told while marking."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import ArrayLike, BoolArray, FloatArray
from ..cameras.base import Camera
from ..errors import RegionError
from ..geometry.contours import resampled
from ..geometry.outlines import fill_loops
from ..geometry.polygons import polygon_moments
from ..geometry.rigid import camera_centre, skew
from .image_region import ImageRegion
from .surface_region import SurfaceRegion

_TURNS = (2, 3, 4, 5, 6, 8)  # rotational symmetries that are looked for
_GRID = 96  # pixels across a region when its symmetry is measured
_ALIKE = 0.93  # overlap with its turned self from which a region counts as symmetric


@dataclass(frozen=True)
class RegionQuality:
    """How a region serves the pose.

    `area` square pixels; `compactness` 4 pi area / perimeter² (1 a disc); `symmetry` the number of turns
    that carry the
    region onto itself (1 none, 0 any: round); `advice` a sentence, empty when all is well.
    """

    area: float
    compactness: float
    symmetry: int
    advice: str


def region_quality(region: ImageRegion, width: int, height: int) -> RegionQuality:
    """Judge a marked region in a photo of `width` x `height` pixels."""
    area = region.area
    perimeter = sum(_length(loop) for loop in _smooth(region))
    compactness = min(1.0, 4 * np.pi * area / perimeter**2) if perimeter > 0 else 0.0
    symmetry = _symmetry(region)
    advice = _advice(region, area, compactness, symmetry, width, height)
    return RegionQuality(area, compactness, symmetry, advice)


def _length(loop: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(loop, axis=0, append=loop[:1]), axis=1).sum())


def _smooth(region: ImageRegion) -> list[FloatArray]:
    """Loops whose length does not count the steps of pixels."""
    return [resampled(loop, 4.0) for loop in region.loops]


def _symmetry(region: ImageRegion) -> int:
    """Order of the region's rotational symmetry in its affine-normalised shape: 1 none, 0 any."""
    outline = max(_smooth(region), key=len)
    means, spreads = polygon_moments(outline[None])
    middle, spread = means[0], spreads[0]
    whiten = np.linalg.inv(np.linalg.cholesky(spread + 1e-9 * np.eye(2)))
    loops = [(loop - middle) @ whiten.T for loop in _smooth(region)]
    first = _picture(loops, 0.0)
    orders = []
    for turns in _TURNS:
        turned = _picture(loops, 2 * np.pi / turns)
        union = np.count_nonzero(first | turned)
        if union and np.count_nonzero(first & turned) / union > _ALIKE:
            orders.append(turns)
    return 0 if {3, 5, 8} <= set(orders) else max(orders, default=1)


def _picture(loops: list[FloatArray], angle: float) -> BoolArray:
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    scaled = [(loop @ turn.T) * (_GRID / 6) + _GRID / 2 for loop in loops]
    return fill_loops(scaled, _GRID, _GRID)


def _advice(
    region: ImageRegion, area: float, compactness: float, symmetry: int, width: int, height: int
) -> str:
    points = np.concatenate(region.loops)
    if points.min() < 0 or np.any(points > np.array([width, height]) - 1.0):
        return "The region is cut off by the photo's edge: mark one that the photo shows whole."
    if area < 2e-4 * width * height:
        return "The region is very small: mark a larger one, or add others."
    if compactness < 0.08:
        return "The region is very thin or ragged: smooth its outline, or mark a broader one."
    if symmetry == 0:
        return "The region is round: alone it leaves the camera's turn open, add another."
    if symmetry > 1:
        return f"The region looks the same in {symmetry} positions: mark another beside it, or give “up”."
    return ""


def expected_covariance(
    camera: Camera,
    rotation: ArrayLike,
    translation: ArrayLike,
    surfaces: Sequence[SurfaceRegion],
    sigma: float = 1.0,
    correlation: float = 20.0,
) -> FloatArray:
    """Pose covariance (6,6) that marking these regions will give, at a nominal pose world to camera.

    `sigma` (pixels) is the deviation of a marked outline across itself, and `correlation` (pixels) the
    length along it
    over which deviations go together. Order and units as in `pose.Pose.covariance`: left perturbation
    exp(w) R in
    rad, then the camera centre in metres.

    Every outline point tells the pose only across the outline: information J^T n n^T J / sigma², summed per
    correlation length.

    Raises
    ------
    RegionError
        No regions, none before the camera, or they leave some motion of the camera wholly open.
    """
    turn, shift = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)
    information = np.zeros((6, 6))
    for surface in surfaces:
        information += _region_information(camera, turn, shift, surface, sigma, correlation)
    covariance = _inverse(information)
    if covariance is None:
        raise RegionError(
            "These regions leave the camera's place open: mark one that is not so far or narrow."
        )
    return covariance


def additions(
    camera: Camera,
    rotation: ArrayLike,
    translation: ArrayLike,
    marked: Sequence[SurfaceRegion],
    others: Sequence[SurfaceRegion],
    sigma: float = 1.0,
    correlation: float = 20.0,
) -> list[tuple[int, float]]:
    """Which of the scan's `others` would make the pose surest if it were marked beside `marked`.

    -> (index, deviation in m that the camera centre's least certain direction then has), best first; without
    those that are not whole in the photo. Further arguments as in `expected_covariance`.
    """
    turn, shift = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)
    known = np.zeros((6, 6))
    for surface in marked:
        known += _region_information(camera, turn, shift, surface, sigma, correlation)
    found = []
    for number, surface in enumerate(others):
        if not _whole(camera, turn, shift, surface):
            continue
        covariance = _inverse(known + _region_information(camera, turn, shift, surface, sigma, correlation))
        if covariance is not None:
            found.append((number, float(np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:])[2]))))
    return sorted(found, key=lambda entry: entry[1])


def _whole(camera: Camera, turn: FloatArray, shift: FloatArray, surface: SurfaceRegion) -> bool:
    corners = np.concatenate(surface.loops) @ turn.T + shift
    pixels = camera.project(corners)
    return bool(np.all(np.isfinite(pixels)) and np.all(camera.in_frame(pixels)))


def _inverse(information: FloatArray) -> FloatArray | None:
    """Covariance of an information matrix (6,6), in scaled units; None where it leaves a motion open."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    normalised = information / np.outer(scale, scale)
    if not np.any(information) or np.linalg.eigvalsh(normalised)[0] < 1e-12:
        return None
    covariance: FloatArray = np.linalg.inv(normalised) / np.outer(scale, scale)
    return covariance


def _region_information(
    camera: Camera,
    turn: FloatArray,
    shift: FloatArray,
    surface: SurfaceRegion,
    sigma: float,
    correlation: float,
) -> FloatArray:
    loops = [_information(camera, turn, shift, loop, sigma, correlation) for loop in surface.loops]
    total: FloatArray = np.sum(loops, axis=0)
    return total


def _information(
    camera: Camera, turn: FloatArray, shift: FloatArray, loop: FloatArray, sigma: float, correlation: float
) -> FloatArray:
    points = resampled(loop, _length(loop) / 400) @ turn.T + shift
    pixels, by_point = camera.project_with_jacobian(points)
    along = 0.5 * (np.roll(pixels, -1, axis=0) - np.roll(pixels, 1, axis=0))
    step = np.linalg.norm(along, axis=1)
    usable = np.isfinite(step) & (step > 0) & camera.in_frame(np.nan_to_num(pixels, nan=-1e9))
    normal = np.stack([-along[usable, 1], along[usable, 0]], axis=1) / step[usable, None]
    # X = exp(w) R (X_w - c): dX/dw = -[X]x, dX/dc = -R
    moved = np.concatenate([-skew(points[usable]), np.broadcast_to(-turn, (int(usable.sum()), 3, 3))], axis=2)
    rows = np.einsum("ni,nij,njk->nk", normal, by_point[usable], moved)
    weight = np.minimum(step[usable] / correlation, 1.0) / sigma**2
    information: FloatArray = np.einsum("n,ni,nj->ij", weight, rows, rows)
    return information


def pose_advice(
    covariance: FloatArray,
    rotation: ArrayLike,
    translation: ArrayLike,
    surfaces: Sequence[SurfaceRegion],
    helpful: tuple[str, float] | None = None,
) -> str:
    """Say what is least certain about the coming pose and which region would help most.

    The camera centre's least certain direction is named as seen from the camera. `helpful` is the name of the
    best addition (see `additions`) and the deviation (m) it leaves; without one that takes a third off, a
    region is asked for whose outline sees that motion.
    """
    turn = np.asarray(rotation, dtype=np.float64)
    values, vectors = np.linalg.eigh(covariance[3:, 3:])
    worst = turn @ vectors[:, 2]
    names = ("position across (left to right)", "height", "depth")
    kind = int(np.argmax(np.abs(worst)))
    sigma = float(np.sqrt(values[2]))
    angle = float(np.degrees(np.sqrt(np.trace(covariance[:3, :3]))))
    said = f"{names[kind].capitalize()} is uncertain by {_metric(sigma)}, the direction by {angle:.2f}°."
    centre = camera_centre(rotation, translation)
    distance = float(np.median([np.linalg.norm(surface.centre - centre) for surface in surfaces]))
    if sigma < 0.002 * distance:
        return said
    if helpful is not None and helpful[1] < 0.7 * sigma:
        return said + f" Mark “{helpful[0]}” as well: {_metric(helpful[1])} then."
    if len({_facing(surface) for surface in surfaces}) <= 1:
        return said + " Add a region on another wall, or well in front of or behind this one."
    return said + " Add a region far from the others in the photo."


def _metric(length: float) -> str:
    if length < 0.001:
        return "less than 1 mm"
    if length < 0.02:
        return f"{length * 1000:.0f} mm"
    return f"{length * 100:.0f} cm" if length < 2 else f"{length:.1f} m"


def _facing(surface: SurfaceRegion) -> tuple[int, ...]:
    """Rough direction of a region's normal, regardless of its sign: equal for regions on one wall."""
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a).sum(axis=0)
    normal /= max(float(np.linalg.norm(normal)), 1e-300)
    normal *= np.sign(normal[np.argmax(np.abs(normal))])
    return tuple(np.round(normal * 2).astype(int).tolist())
