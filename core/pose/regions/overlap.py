"""Overlap error of projected surface regions with the photo's regions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import BoolArray, FloatArray
from ...geometry.outlines import fill_edges
from .moment_pair import MomentPair

RASTER = 300.0  # cells along a region: the root of its area
ROUGHLY = 100.0  # the same where a few per cent do not matter


def overlap_errors(
    pairs: Sequence[MomentPair], rotation: FloatArray, translation: FloatArray, cells: float = RASTER
) -> tuple[float, tuple[float, ...]]:
    """Overlap error δ in percent over all pairs, and of each: `100 |A xor B| / (|A| + |B|)`.

    Areas are counted on a raster of each region's chart with `cells` along its root. Source: method.md 2.8.
    """
    differing, total = [], []
    for pair in pairs:
        observed, projected = _rasters(pair, rotation, translation, cells)
        differing.append(float(np.count_nonzero(observed != projected)))
        total.append(float(np.count_nonzero(observed) + np.count_nonzero(projected)))
    each = tuple(100.0 * d / max(t, 1.0) for d, t in zip(differing, total, strict=True))
    return 100.0 * sum(differing) / max(sum(total), 1.0), each


def _rasters(
    pair: MomentPair, rotation: FloatArray, translation: FloatArray, cells: float
) -> tuple[BoolArray, BoolArray]:
    """Both shapes on one raster."""
    projected = [
        (pair.chart.flatten(a @ rotation.T + translation), pair.chart.flatten(b @ rotation.T + translation))
        for a, b in pair.parts
    ]
    scale = cells / np.sqrt(pair.moments[0])
    low = pair.outline[0].min(axis=0) - 0.2
    width, height = np.ceil((pair.outline[0].max(axis=0) + 0.2 - low) * scale).astype(int)
    filled = []
    for parts in ([pair.outline], projected):
        mask = np.zeros((height, width), dtype=bool)
        for a, b in parts:
            if not (np.all(np.isfinite(a)) and np.all(np.isfinite(b))):
                continue  # not seen at all from there
            mask |= fill_edges((a - low) * scale, (b - low) * scale, width, height)
        filled.append(mask)
    return filled[0], filled[1]
