"""Which of many outlines to take: the one that overlaps most with what the region may be.

The outline with the best score can be alone among many that are nearly as good and like one another; the one
with the largest expected overlap is among them. Source: decision by expected loss, Berger, Statistical
Decision Theory and Bayesian Analysis, 1985, chapter 1.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from ...arrays import FloatArray

_COMPARED = 60  # best outlines that may be the region
_GRID = 128  # pixels of both sides of the grid on which outlines are compared
_SHIFT = 4  # cv2 draws at sixteenths of a pixel


def expected_overlaps(loops: Sequence[FloatArray], score: FloatArray, doubt: float) -> FloatArray:
    """Expected overlap (N,), intersection over union, of closed loops (n,2) with the region that is meant.

    `score` (N,) are log odds, -inf for what cannot be; `doubt` divides them: learned scores are too sure.
    Beyond the best 60, outlines get -inf.
    """
    best = np.argsort(-score, kind="stable")[:_COMPARED]
    best = best[np.isfinite(score[best])]
    odds = np.exp((score[best] - score[best].max(initial=-np.inf)) / doubt)
    expected = np.full(len(score), -np.inf)
    if len(best):
        expected[best] = overlaps([loops[k] for k in best.tolist()]) @ (odds / odds.sum())
    return expected


def overlaps(loops: Sequence[FloatArray]) -> FloatArray:
    """Intersection over union (N,N) of every two of N closed loops (n,2), drawn on a coarse grid."""
    points = np.concatenate(loops)
    low = points.min(axis=0)
    scale = (_GRID - 1) / np.maximum(np.ptp(points, axis=0), 1e-9)  # other scales, same shares
    masks = np.zeros((len(loops), _GRID, _GRID), dtype=np.uint8)
    for mask, loop in zip(masks, loops, strict=True):
        corners = np.round((loop - low) * scale * 2**_SHIFT).astype(np.int32)
        cv2.fillPoly(mask, [corners[:, None]], (1,), shift=_SHIFT)
    flat = masks.reshape(len(loops), -1).astype(np.float32)
    shared = (flat @ flat.T).astype(np.float64)
    area = np.diag(shared)
    share: FloatArray = shared / np.maximum(area[:, None] + area - shared, 1e-9)
    return share
