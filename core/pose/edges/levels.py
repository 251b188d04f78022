"""The sizes at which a photo's edges are aligned, and which edges take part."""

from __future__ import annotations

import numpy as np

from ...photos.view import View
from ...settings import EdgeSettings
from ..points.pictures import read_view, read_view_mask
from .alignment import Photo
from .photo_edges import photo_edge_field
from .rendering import Scan
from .scan_edges import ScanEdges

TILES = 32
"""The longer side of a photo is cut into so many tiles that either take part in the fit or do not."""

ROUGH = 10.0
"""Angle (degrees) between faces and averaged normals at which a scan counts as noisy."""


def photo_at(view: View, scale: float, scan: Scan, settings: EdgeSettings) -> Photo:
    """The photo's edges at `scale`; those of a noisy scan are doubted more."""
    field = photo_edge_field(read_view(view, scale), read_view_mask(view, scale))
    doubt = 0.75 * settings.search * min(1.0, scan.noise / np.radians(ROUGH))
    return Photo(view.camera.scaled(scale), field, settings.search, float(doubt))


def finest_scale(view: View, settings: EdgeSettings) -> float:
    """Image scale of the finest level; a pixel may be smaller than a triangle, as creases are sharp."""
    return min(1.0, settings.photo_size / max(view.camera.width, view.camera.height))


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
