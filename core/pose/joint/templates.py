"""Sightings placed to hundredths of a pixel: what one photo shows around a point is sought in the others.

The scan and the poses tell how the surroundings are distorted from photo to photo, so that only a shift and
the brightness are left to find. Features are found in each photo on its own and lie up to a few tenths of a
pixel apart where it is seen from other sides. Source: least-squares matching (Gruen 1985), in the inverse
compositional form of Baker and Matthews 2004.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ...arrays import BoolArray, ByteArray, Float32Array, FloatArray, IndexArray
from ...cameras.base import Camera
from ...jobs import Job, Progress
from ...photos.view import View
from ..points.pictures import read_view, view_name
from .adjustment import Network, Problem, in_camera
from .tracks import Tracks

HALF = 6
"""Points of a template's grid on each side of its middle."""

SPACING = 0.4
"""Distance of grid points by the size of the feature (of which the smallest have 1), at least one pixel."""

ROUNDS = 5
"""Steps of the search."""

ALIKE = 0.85
"""Correlation of a template with where it is found, at least."""

FARTHEST = 1.0
"""Pixels by which a template may lie beside its feature at most, per size of the feature."""

UNPLACED = 3.0
"""How much less exact a sighting is whose template was not found."""

LEVELS = 4
"""Halvings of a photo: the coarsest features are compared on small copies."""

GRID = np.stack(np.meshgrid(*[np.arange(-HALF, HALF + 1.0)] * 2), axis=-1).reshape(-1, 2)
"""Grid points (G,2) of a template."""

WEIGHT = np.exp(-(GRID**2).sum(axis=1) / (2 * (0.6 * HALF) ** 2))
"""Weights (G,) of the grid points, which fade towards the border."""


@dataclass(frozen=True, eq=False)
class Warps:
    """How templates lie in photos.

    `reference` (T,): sighting that each track's template is taken from. `affine` (M,2,2): pixels of a
    sighting's photo by steps of the template's grid.
    """

    reference: IndexArray
    affine: FloatArray


@dataclass(frozen=True, eq=False)
class Picture:
    """A photo's grey levels as `levels`, each half as large; `scale`: pixels of the first one by photo's."""

    levels: Sequence[ByteArray]
    scale: float

    @classmethod
    def of(cls, view: View, size: int) -> Picture:
        """Picture of a view, reduced to `size` pixels at most."""
        scale = min(1.0, size / max(view.camera.width, view.camera.height))
        grey = cv2.cvtColor(read_view(view, scale), cv2.COLOR_RGB2GRAY)
        levels = [cv2.GaussianBlur(grey, (0, 0), 0.7).astype(np.uint8, copy=False)]
        while len(levels) < LEVELS and min(levels[-1].shape) > 4 * HALF:
            half = cv2.resize(levels[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
            levels.append(half.astype(np.uint8, copy=False))
        return cls(levels, scale)

    def sample(self, pixels: FloatArray, affine: FloatArray) -> Float32Array:
        """Grey levels (K,G) around photo pixels (K,2), at grid steps of `affine` (K,2,2)."""
        step = np.sqrt(np.abs(np.linalg.det(affine))) * self.scale
        level = np.clip(np.round(np.log2(np.maximum(step, 1.0))), 0, len(self.levels) - 1)
        out = np.zeros((len(pixels), len(GRID)), np.float32)
        for number, grey in enumerate(self.levels):
            mine = level == number
            if mine.any():
                scale = self.scale / 2.0**number
                around = GRID @ np.swapaxes(scale * affine[mine], 1, 2)
                at = around + ((pixels[mine] + 0.5) * scale - 0.5)[:, None]
                out[mine] = _interpolated(grey, at.astype(np.float32))
        return out


def _interpolated(grey: ByteArray, at: Float32Array) -> ByteArray:
    """Grey levels (K,G) at pixels (K,G,2)."""
    out = np.empty(at.shape[:2], np.uint8)
    # OpenCV takes no more than 32767 rows at once
    for start in range(0, len(at), 1 << 14):
        some = at[start : start + (1 << 14)]
        columns, rows = np.ascontiguousarray(some[..., 0]), np.ascontiguousarray(some[..., 1])
        out[start : start + (1 << 14)] = cv2.remap(
            grey, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
    return out


def place_sightings_job(
    views: Sequence[View], cameras: Sequence[Camera], problem: Problem, network: Network, size: int
) -> Job[Tracks]:
    """Tracks of a problem whose sightings lie where the photos, reduced to `size` px, show the same.

    A sighting whose template is not found keeps its place and counts as less exact.
    """
    tracks = problem.tracks
    warps = _warps(problem, network, cameras)
    first = warps.reference
    templates = np.zeros((len(first), len(GRID)), np.uint8)
    spots, found = tracks.pixels.copy(), np.zeros(len(tracks.view), dtype=bool)
    found[first] = True
    for number, view in enumerate(views):
        yield Progress(0.4 * number / len(views), f"Templates of {view_name(view, number)}")
        shown = np.flatnonzero(tracks.view[first] == number)
        if len(shown):
            picture = Picture.of(view, size)
            templates[shown] = picture.sample(tracks.pixels[first[shown]], warps.affine[first[shown]])
    for number, view in enumerate(views):
        yield Progress(0.4 + 0.6 * number / len(views), f"Placing features of {view_name(view, number)}")
        mine = np.flatnonzero((tracks.view == number) & ~found)
        if len(mine):
            picture, wanted = Picture.of(view, size), templates[tracks.track[mine]]
            at, alike = _align(picture, tracks.pixels[mine], warps.affine[mine], wanted)
            near = np.linalg.norm(at - tracks.pixels[mine], axis=1) < FARTHEST * tracks.size[mine]
            good = mine[near & (alike > ALIKE)]
            spots[good], found[good] = at[near & (alike > ALIKE)], True
    return _moved(tracks, spots, found, cameras)


def _moved(tracks: Tracks, pixels: FloatArray, found: BoolArray, cameras: Sequence[Camera]) -> Tracks:
    """Tracks with sightings at other pixels (M,2); those not `found` (M,) count less."""
    rays, to_pixels = tracks.rays.copy(), tracks.to_pixels.copy()
    for number, camera in enumerate(cameras):
        mine = np.flatnonzero(tracks.view == number)
        turned = camera.unproject(pixels[mine])
        by_ray = camera.project_with_jacobian(turned)[1]
        seen = np.isfinite(turned).all(axis=1) & np.isfinite(by_ray).all(axis=(1, 2))
        rays[mine[seen]], to_pixels[mine[seen]] = turned[seen], by_ray[seen]
    size = tracks.size * np.where(found, 1.0, UNPLACED)
    return replace(tracks, pixels=pixels, rays=rays, to_pixels=to_pixels, size=size)


def _warps(problem: Problem, network: Network, cameras: Sequence[Camera]) -> Warps:
    """Distortion of the surroundings of each track's point, taken as flat there."""
    tracks = problem.tracks
    towards = in_camera(network, tracks)
    across = _tangents(problem, network)[tracks.track]
    by_tangent = np.empty((len(towards), 2, 2))
    for number, camera in enumerate(cameras):
        mine = tracks.view == number
        slopes = camera.project_with_jacobian(towards[mine])[1] @ network.rotations[number]
        by_tangent[mine] = slopes @ across[mine]
    size = np.abs(np.linalg.det(by_tangent))
    # seen neither largest nor smallest: the others differ least from that one
    order = np.lexsort((size, tracks.track))
    start = np.searchsorted(tracks.track, np.arange(tracks.count + 1))
    reference = order[(start[:-1] + start[1:]) // 2]
    spacing = np.maximum(1.0, SPACING * tracks.size[reference])
    steps = spacing[:, None, None] * _inverses(by_tangent[reference])
    return Warps(reference.astype(np.int64), by_tangent @ steps[tracks.track])


def _inverses(matrices: FloatArray) -> FloatArray:
    """Inverses (K,2,2), NaN where the surface is seen edge on."""
    open_ = np.abs(np.linalg.det(matrices)) > 1e-9
    out = np.full_like(matrices, np.nan)
    out[open_] = np.linalg.inv(matrices[open_])
    return out


def _tangents(problem: Problem, network: Network) -> FloatArray:
    """Two directions (T,3,2) along the surface at each track's point; without a scan, across the view."""
    tracks = problem.tracks
    first = np.searchsorted(tracks.track, np.arange(tracks.count))
    away = network.points - network.centres[tracks.view[first]]
    tied = np.isfinite(problem.ties.normals[:, :1])
    normal = np.where(tied, problem.ties.normals, away)
    helper = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    one = np.cross(normal, helper)
    other = np.cross(normal, one)
    both = np.stack([one, other], axis=2)
    out: FloatArray = both / np.linalg.norm(both, axis=1, keepdims=True)
    return out


def _align(
    picture: Picture, pixels: FloatArray, affine: FloatArray, templates: ByteArray
) -> tuple[FloatArray, FloatArray]:
    """Pixels (K,2) near the given ones that look most like the templates (K,G), and correlations (K,)."""
    wanted = templates.astype(np.float64)
    side = 2 * HALF + 1
    down, right = np.gradient(wanted.reshape(-1, side, side), axis=(1, 2))
    design = np.stack([right.reshape(wanted.shape), down.reshape(wanted.shape), wanted], axis=2)
    design = np.concatenate([design, np.ones((*wanted.shape, 1))], axis=2)
    weighted = np.swapaxes(design * WEIGHT[:, None], 1, 2)
    solver = np.linalg.pinv(weighted @ design, hermitian=True) @ weighted
    at = pixels.copy()
    for _ in range(ROUNDS):
        right_down_gain = (solver @ picture.sample(at, affine)[:, :, None])[:, :3, 0]
        # what is seen there is the template moved by this much, so its middle lies the other way
        gain = np.maximum(right_down_gain[:, 2:], 0.2)
        moved = np.clip(right_down_gain[:, :2] / gain, -1.0, 1.0)
        at -= np.einsum("kij,kj->ki", affine, moved)
    return at, _correlation(picture.sample(at, affine).astype(np.float64), wanted)


def _correlation(a: FloatArray, b: FloatArray) -> FloatArray:
    """Weighted correlation (K,) of grey levels (K,G); 0 where there is no contrast."""
    share = WEIGHT / WEIGHT.sum()
    a, b = a - (a @ share)[:, None], b - (b @ share)[:, None]
    norm = np.sqrt(((a * a) @ share) * ((b * b) @ share))
    out: FloatArray = ((a * b) @ share) / np.maximum(norm, 1e-6)
    return out
