"""One gain per photo and channel, in linear light, so that the photos agree where they overlap."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ...arrays import ByteArray, FloatArray, IndexArray
from ..views.candidates import CandidateTable
from ..views.images import to_bytes, to_linear, to_srgb

_DARKEST, _BRIGHTEST = 10, 245
"""Channel values outside are noise or burnt out and say nothing about exposure."""
_FACES = 60_000
_SLOTS = 6
_FEWEST = 12
"""Faces in common below which a pair of photos is not compared."""
_PRIOR = 1e-4
"""Weight that holds a photo at the mean where nothing else does."""


def photo_gains(table: CandidateTable, view_count: int, anchor: int | None = None) -> FloatArray:
    """Linear RGB factors (V,3) that make the photos agree on the faces they share.

    For each pair of photos the median log ratio over common faces is one observation; gains solve them all by
    least squares, reweighted (Cauchy) against pairs that contradict the rest. The ratios leave one factor
    free per group of overlapping photos: the median gain is 1, so that most photos stay nearly as they are
    whatever a few exposures do; or that of the photo `anchor` is.
    """
    first, second, ratio = _observations(table)
    if len(first) == 0:
        return np.ones((view_count, 3))
    pair, value, weight = _pair_medians(first.astype(np.int64) * view_count + second, ratio)
    i, j = pair // view_count, pair % view_count
    groups = connected_components(
        coo_matrix((np.ones(len(i)), (i, j)), shape=(view_count, view_count)), directed=False
    )[1]
    log_gain = np.stack([_solve(i, j, value[:, c], weight[:, c], view_count) for c in range(3)], axis=1)
    for group in np.unique(groups):
        members = np.flatnonzero(groups == group)
        log_gain[members] -= log_gain[anchor] if anchor in members else np.median(log_gain[members], axis=0)
    return np.exp(log_gain)


def corrected_colours(table: CandidateTable, gain: FloatArray) -> ByteArray:
    """Colours of the candidates after the gains (V,3): (F,K,3) sRGB."""
    codes = to_linear(np.arange(256, dtype=np.uint8))[None, :, None] * gain[:, None, :]
    lookup = to_bytes(to_srgb(codes))  # (V,256,3)
    out = table.colour.copy()
    for view in range(len(gain)):
        at = table.of_view(view)
        colour = table.colour[at]
        for channel in range(3):
            colour[:, channel] = lookup[view, :, channel][colour[:, channel]]
        out[at] = colour
    return out


def _observations(table: CandidateTable) -> tuple[IndexArray, IndexArray, FloatArray]:
    """Pairs of photos on the same face: photo numbers i < j and the log ratio of their colours (n,3)."""
    rows = np.arange(0, len(table.view), max(1, len(table.view) // _FACES))
    slots = np.argsort(table.cost[rows], axis=1, kind="stable")[:, :_SLOTS]
    view = np.take_along_axis(table.view[rows], slots, axis=1)
    colour = np.take_along_axis(table.colour[rows], slots[..., None], axis=1)
    usable = (colour >= _DARKEST) & (colour <= _BRIGHTEST) & (view >= 0)[..., None]
    with np.errstate(divide="ignore"):
        log = np.where(usable, np.log(to_linear(colour).astype(np.float64)), np.nan)
    first, second, ratio = [], [], []
    for a, b in combinations(range(slots.shape[1]), 2):
        both = np.isfinite(log[:, a]).any(axis=1) & np.isfinite(log[:, b]).any(axis=1)
        swap = view[both, a] > view[both, b]
        first.append(np.where(swap, view[both, b], view[both, a]))
        second.append(np.where(swap, view[both, a], view[both, b]))
        difference = log[both, a] - log[both, b]
        ratio.append(np.where(swap[:, None], -difference, difference))
    if not first:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3))
    return np.concatenate(first), np.concatenate(second), np.concatenate(ratio)


def _pair_medians(pair: IndexArray, ratio: FloatArray) -> tuple[IndexArray, FloatArray, FloatArray]:
    """Median ratio and its weight per pair and channel: (n,), (n,3) -> (P,), (P,3), (P,3)."""
    numbers = np.unique(pair)
    median, weight = np.zeros((len(numbers), 3)), np.zeros((len(numbers), 3))
    for channel in range(3):
        known = np.isfinite(ratio[:, channel])
        code, value = pair[known], ratio[known, channel]
        order = np.lexsort((value, code))
        code, value = code[order], value[order]
        found, start, count = np.unique(code, return_index=True, return_counts=True)
        at = np.searchsorted(numbers, found)
        median[at, channel] = value[start + count // 2]
        spread = value[start + (3 * count) // 4] - value[start + count // 4]
        # The error of a median falls with the square root of the count; faces of one patch err together.
        weight[at, channel] = np.where(count >= _FEWEST, np.sqrt(count) / (0.01 + spread) ** 2, 0)
    return numbers, median, weight


def _solve(i: IndexArray, j: IndexArray, ratio: FloatArray, weight: FloatArray, count: int) -> FloatArray:
    """Log gains g with `g_i - g_j = -ratio_ij`, weighted and robust: -> (V,)."""
    gain = np.zeros(count)
    weight = weight / max(float(weight.max(initial=0.0)), 1e-300)
    for _ in range(12):
        residual = ratio + gain[i] - gain[j]
        scale = max(
            1.4826 * float(np.median(np.abs(residual[weight > 0])) if np.any(weight > 0) else 0), 0.01
        )
        robust = weight / (1 + (residual / (2 * scale)) ** 2)
        normal = np.zeros((count, count))
        np.add.at(normal, (i, i), robust)
        np.add.at(normal, (j, j), robust)
        np.add.at(normal, (i, j), -robust)
        np.add.at(normal, (j, i), -robust)
        right = np.zeros(count)
        np.add.at(right, i, -robust * ratio)
        np.add.at(right, j, robust * ratio)
        normal += _PRIOR * max(float(robust.max(initial=0.0)), 1e-12) * np.eye(count)
        gain = np.linalg.solve(normal, right)
    return gain
