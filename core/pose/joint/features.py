"""Features of photos and the places on the scan that their rays meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ...arrays import ByteArray, Float32Array, FloatArray, IndexArray
from ...cameras.base import Camera
from ...geometry.meshes import vertex_normals
from ...geometry.rays import RayCaster
from ...photos.view import View
from ...settings import JointSettings
from ..points.pictures import read_view, read_view_mask
from ..points.smoothing import averaged_normals

NORMAL_ROUNDS = 6
"""Rounds of averaging normals with their neighbours: about three edge lengths of the mesh around."""


@dataclass(frozen=True, eq=False)
class Features:
    """Features of one photo.

    `pixels` (N,2) of the full photo, `size` (N,) diameter in its pixels, `descriptors` (N,128) bytes,
    strongest first. `rays` (N,3) unit, camera frame; `to_pixels` (N,2,3) turns a change of
    direction into pixels.
    """

    pixels: FloatArray
    size: FloatArray
    descriptors: ByteArray
    rays: FloatArray
    to_pixels: FloatArray

    def __len__(self) -> int:
        return len(self.pixels)


@dataclass(frozen=True, eq=False)
class Surface:
    """The scan made ready: `caster` for rays, unit `normals` (F,3) of its faces.

    The normals are averaged over a neighbourhood, so that the noise of single faces does not pass for relief.
    """

    caster: RayCaster
    normals: FloatArray

    @classmethod
    def of_mesh(cls, vertices: FloatArray, faces: IndexArray) -> Surface:
        """Surface of vertices (V,3) m and faces (F,3)."""
        normals = averaged_normals(vertex_normals(vertices, faces), faces, NORMAL_ROUNDS)[faces].sum(axis=1)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return cls(RayCaster(vertices, faces), normals / np.where(length > 0, length, 1.0))


@dataclass(frozen=True, eq=False)
class Hits:
    """Where rays meet the scan: `points` (N,3) m and `normals` (N,3) unit, NaN where they miss."""

    points: FloatArray
    normals: FloatArray


def detect_features(view: View, settings: JointSettings) -> Features:
    """SIFT features of a photo, spread over it by a grid and strongest first.

    Source: Lowe 2004; square-rooted descriptors of Arandjelović and Zisserman 2012.
    """
    scale = min(1.0, settings.photo_size / max(view.camera.width, view.camera.height))
    grey = cv2.cvtColor(read_view(view, scale), cv2.COLOR_RGB2GRAY)
    mask = read_view_mask(view, scale)
    sift = cv2.SIFT.create(contrastThreshold=0.01, enable_precise_upscale=True)
    keypoints = sift.detect(grey, None if mask is None else mask.astype(np.uint8))
    chosen = _spread(keypoints, grey.shape, settings.features)
    kept, descriptors = sift.compute(grey, [keypoints[int(i)] for i in chosen])
    if descriptors is None or len(kept) == 0:
        kept, descriptors = (), np.zeros((0, 128), np.float32)
    pixels = (np.array([k.pt for k in kept], dtype=np.float64).reshape(-1, 2) + 0.5) / scale - 0.5
    size = np.array([k.size for k in kept], dtype=np.float64) / scale
    rays = view.camera.unproject(pixels)
    seen = np.isfinite(rays).all(axis=1)
    to_pixels = view.camera.project_with_jacobian(rays[seen])[1]
    return Features(
        pixels[seen], size[seen], _rooted(descriptors.astype(np.float32))[seen], rays[seen], to_pixels
    )


def resighted(features: Features, camera: Camera) -> Features:
    """The same features seen through another camera; those that it does not see keep their rays."""
    rays = camera.unproject(features.pixels)
    to_pixels = camera.project_with_jacobian(rays)[1]
    seen = np.isfinite(rays).all(axis=1) & np.isfinite(to_pixels).all(axis=(1, 2))
    rays = np.where(seen[:, None], rays, features.rays)
    return replace(
        features, rays=rays, to_pixels=np.where(seen[:, None, None], to_pixels, features.to_pixels)
    )


def _spread(keypoints: Sequence[cv2.KeyPoint], shape: tuple[int, ...], count: int) -> IndexArray:
    """Indices of at most `count` keypoints, the best of every grid cell first."""
    if not keypoints:
        return np.zeros(0, dtype=np.int64)
    pixels = np.array([k.pt for k in keypoints])
    response = np.array([k.response for k in keypoints])
    cell_size = np.sqrt(shape[0] * shape[1] / max(1.0, count / 8))
    cell = (pixels // cell_size).astype(np.int64) @ np.array([1, 10000])
    order = np.lexsort((-response, cell))
    start = np.r_[True, cell[order][1:] != cell[order][:-1]]
    rank = np.arange(len(order)) - np.maximum.accumulate(np.where(start, np.arange(len(order)), 0))
    by_rank: IndexArray = order[np.lexsort((-response[order], rank))].astype(np.int64)
    return by_rank[:count]


def _rooted(descriptors: Float32Array) -> ByteArray:
    share = descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-12)
    rooted: ByteArray = np.minimum(np.round(512 * np.sqrt(share)), 255).astype(np.uint8)
    return rooted


def meet_scan(rays: FloatArray, rotation: FloatArray, centre: FloatArray, surface: Surface) -> Hits:
    """First points of the scan along rays (N,3) of a camera; back sides do not count."""
    directions = rays @ rotation
    hits = surface.caster.first_hit(centre, directions)
    normals = surface.normals[np.maximum(hits.face, 0)]
    facing = np.einsum("nj,nj->n", normals, directions)
    struck = (hits.face >= 0) & (np.abs(facing) > 0.05)
    distance = np.where(struck, hits.distance.astype(np.float64), np.nan)
    return Hits(centre + distance[:, None] * directions, np.where(struck[:, None], normals, np.nan))
