"""What a photo shows in a narrow band along an outline, at full resolution.

A large region has a hundred times more pixels inside than along its outline: only those are read.
"""

from __future__ import annotations

import numpy as np

from ...arrays import ByteArray, FloatArray
from ...jobs import Job, Progress
from .edges import Gradient, evened, gradient, lab

_STRETCH = 250.0  # pixels of an outline that are read at once
_NEIGHBOURHOOD = 40  # pixels over which contrast is evened out


def across_band_job(photo: ByteArray, places: FloatArray, normals: FloatArray) -> Job[FloatArray]:
    """Gradient (n,m) along unit normals (n,2) at places (n,m,2), n of them in order along an outline."""
    middle = places[:, places.shape[1] // 2]
    length = float(np.linalg.norm(np.diff(middle, axis=0), axis=1).sum())
    count = min(max(1, round(length / _STRETCH)), len(places))
    found = np.empty(places.shape[:2])
    for number, members in enumerate(np.array_split(np.arange(len(places)), count)):
        yield Progress(number / count, "Moving the outline onto the edges")
        origin, edges = _edges_around(photo, places[members].reshape(-1, 2))
        found[members] = np.sum(edges.at(places[members] - origin) * normals[members, None], axis=-1)
    return found


def _edges_around(photo: ByteArray, points: FloatArray) -> tuple[FloatArray, Gradient]:
    """Gradient of the part of a photo around points (n,2), and the pixel (2,) of its top-left corner."""
    height, width = photo.shape[:2]
    low = np.clip(np.floor(points.min(axis=0)).astype(int) - _NEIGHBOURHOOD, 0, [width - 8, height - 8])
    high = np.ceil(points.max(axis=0)).astype(int) + _NEIGHBOURHOOD + 1
    high = np.clip(high, low + 8, [width, height])
    crop = np.ascontiguousarray(photo[low[1] : high[1], low[0] : high[0]])
    return low.astype(np.float64), gradient(evened(lab(crop)))
