"""The sizes at which a photo's edges are aligned, and which edges take part."""

from __future__ import annotations

import numpy as np

from ...cameras.resolution import angular_resolution
from ...photos.view import View
from ...settings import EdgeSettings
from ..points.pictures import read_view, read_view_mask
from .alignment import Photo, PosePrior
from .photo_edges import photo_edge_field
from .rendering import ROUGH, EdgeScan
from .scan_edges import ScanEdges

COARSEST = 480.0
"""Longer side (px) below which the finest level is not reduced, however coarse a noisy scan is."""

PER_TRIANGLE = 2.0
"""Pixels of the finest level along a triangle's side of a noisy scan."""

TILES = 32
"""The longer side of a photo is cut into so many tiles that either take part in the fit or do not."""


def photo_at(view: View, scale: float, scan: EdgeScan, settings: EdgeSettings) -> Photo:
    """The photo's edges at `scale`; those of a noisy scan are doubted more."""
    field = photo_edge_field(read_view(view, scale), read_view_mask(view, scale))
    doubt = 0.75 * settings.search * min(1.0, scan.noise / ROUGH)
    return Photo(view.camera.scaled(scale), field, settings.search, float(doubt))


def triangle_size(view: View, prior: PosePrior, scan: EdgeScan) -> float:
    """Median side of the scan's triangles as seen from the pose, in pixels of the full photo."""
    camera = view.camera
    columns, rows = np.linspace(0, camera.width - 1, 48), np.linspace(0, camera.height - 1, 48)
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    hits = scan.caster.first_hit(prior.centre, camera.unproject(pixels) @ prior.rotation)
    struck = hits.face >= 0
    if not struck.any():
        return 1.0
    corners = scan.vertices[scan.faces[hits.face[struck]]]
    side = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean(axis=1)
    return float(np.nanmedian(side / hits.distance[struck] / angular_resolution(camera, pixels[struck])))


def finest_scale(view: View, prior: PosePrior, scan: EdgeScan, settings: EdgeSettings) -> float:
    """Largest image scale that makes sense: a noisy scan has no fine edges."""
    largest = max(view.camera.width, view.camera.height)
    scale = min(1.0, settings.photo_size / largest)
    if not scan.noisy:
        return scale
    sensible = PER_TRIANGLE / triangle_size(view, prior, scan)
    return float(np.clip(sensible, min(COARSEST / largest, scale), scale))


def divided_edges(
    photo: Photo, edges: ScanEdges, settings: EdgeSettings, rng: np.random.Generator
) -> tuple[ScanEdges, ScanEdges]:
    """Edges for the fit and those held back for the score: one tile in four, the same ones at all levels."""
    side = max(photo.camera.width, photo.camera.height) / TILES
    tile = (edges.pixels // side).astype(np.int64)
    held = (tile[:, 0] + 2 * tile[:, 1]) % 4 == 0
    return _at_most(edges.select(~held), settings.max_edges, rng), _at_most(
        edges.select(held), settings.max_edges, rng
    )


def _at_most(edges: ScanEdges, count: int, rng: np.random.Generator) -> ScanEdges:
    if len(edges) <= count:
        return edges
    return edges.select(np.sort(rng.choice(len(edges), count, replace=False)))
