"""How much a region grown around a click looks like one that a surveyor would mark."""

from __future__ import annotations

import cv2
import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray
from .surface_graph import from_neighbours
from .surface_growing import Part, SurfaceLevel

_TURNED = 25.0  # degrees beyond the border that make it a crease


def shape_score(piece: Part, level: SurfaceLevel, noise: float) -> float:
    """Log score of a level, its patches numbered as in the part.

    Solid, thin for its size, ended by edges, around the click.
    """
    chosen = level.patches
    if len(chosen) < 4:
        return float(np.log(1e-3))
    inside = np.zeros(len(piece.node), dtype=np.bool_)
    inside[chosen] = True
    pair = piece.pair[inside[piece.pair[:, 0]] != inside[piece.pair[:, 1]]]
    border = np.unique(pair[inside[pair]]) if len(pair) else chosen
    border = np.concatenate([border, chosen[piece.rim[chosen]]])
    outline = (piece.middle[border] - level.fit.centre) @ level.fit.axes[:2].T
    hull = float(cv2.contourArea(cv2.convexHull(outline.astype(np.float32))))
    flat = float(piece.area[chosen] @ np.abs(piece.normal[chosen] @ level.fit.normal))
    solidity = min(1.0, flat / max(hull, 1e-12))
    flatness = max(1 - 4 * level.tolerance / float(np.sqrt(level.area)), 0.05)
    crisp = max(_crispness(piece, level, inside, pair, noise), 1e-3)
    return float(2 * np.log(max(solidity, 1e-3)) + np.log(crisp * flatness) + _central(piece, level))


def stability_score(area: float, larger: float) -> float:
    """Log score of a level of `area` m² whose next, more tolerant one has `larger`: few change is good."""
    return float(2 * np.log(max(min(area, larger) / max(area, larger, 1e-300), 1e-3)))


def _central(piece: Part, level: SurfaceLevel) -> float:
    """Up to -1.8 for a click far from the middle of the region: people click into the middle."""
    step = max(1, len(level.patches) // 2000)
    plane = (piece.middle[level.patches[::step]] - level.fit.centre) @ level.fit.axes[:2].T
    off = (piece.middle[piece.seed] - level.fit.centre) @ level.fit.axes[:2].T - plane.mean(axis=0)
    spread = np.cov(plane.T) + 1e-12 * np.eye(2)
    return -0.15 * min(float(off @ np.linalg.solve(spread, off)) / 0.15**2, 12.0)


def _crispness(piece: Part, level: SurfaceLevel, inside: BoolArray, pair: IntArray, noise: float) -> float:
    """Share of the border, pairs (n,2), where the surface beyond turns away, steps up or down, or ends."""
    ends = int(np.count_nonzero(inside & piece.rim))
    if len(pair) + ends == 0:
        return 1.0
    swapped = ~inside[pair[:, 0]]
    within = np.where(swapped, pair[:, 1], pair[:, 0])
    beyond = np.where(swapped, pair[:, 0], pair[:, 1])
    normals = level.fit.normals(piece.middle[beyond])
    turned = np.abs(np.einsum("nk,nk->n", piece.normal[beyond], normals))
    edge = turned < np.cos(np.radians(_TURNED))
    edge |= _step(piece, level, inside, within, beyond) > 3 * noise
    return (int(np.count_nonzero(edge)) + ends) / (len(beyond) + ends)


def _step(
    piece: Part, level: SurfaceLevel, inside: BoolArray, within: IntArray, beyond: IntArray
) -> FloatArray:
    """Height (n,) m of the border: the surface's offset a patch beyond it against a patch before it."""
    touching = np.zeros(len(inside), dtype=np.bool_)
    touching[within] = touching[beyond] = True
    same = piece.pair[touching[piece.pair[:, 0]] | touching[piece.pair[:, 1]]]
    same = same[inside[same[:, 0]] == inside[same[:, 1]]]
    node, number = np.unique(np.concatenate([within, beyond, same.ravel()]), return_inverse=True)
    off = level.fit.distance(piece.middle[node])
    pair = number[2 * len(within) :].reshape(-1, 2)
    count = np.bincount(pair.ravel(), minlength=len(node))
    mean = from_neighbours(off[:, None], pair)[:, 0] / np.maximum(count, 1)
    mean = np.where(count > 0, mean, off)
    first, second = number[: len(within)], number[len(within) : 2 * len(within)]
    height: FloatArray = np.abs(mean[second] - mean[first])
    return height
