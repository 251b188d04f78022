"""Matches chained through several photos into tracks: one point of the scan each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ...arrays import BoolArray, FloatArray, IndexArray
from .features import Features, Hits


@dataclass(frozen=True, eq=False)
class Tracks:
    """Sightings of scan points, sorted by track.

    Per sighting: `view` (M,), `feature` (M,), `track` (M,); `pixels` (M,2), `rays` (M,3),
    `to_pixels` (M,2,3) and `size` (M,): standard deviation of the pixel relative to the smallest features.
    """

    view: IndexArray
    feature: IndexArray
    track: IndexArray
    pixels: FloatArray
    rays: FloatArray
    to_pixels: FloatArray
    size: FloatArray

    @property
    def count(self) -> int:
        """Number of tracks."""
        return int(self.track[-1]) + 1 if len(self.track) else 0

    def select(self, kept: BoolArray) -> Tracks:
        """Return the sightings `kept` (M,), without tracks that fewer than two photos see; renumbered."""
        seen = np.bincount(self.track[kept], minlength=self.count)
        kept = kept & (seen[self.track] >= 2)
        numbers = np.unique(self.track[kept], return_inverse=True)[1]
        return Tracks(
            self.view[kept],
            self.feature[kept],
            numbers.astype(np.int64),
            self.pixels[kept],
            self.rays[kept],
            self.to_pixels[kept],
            self.size[kept],
        )

    def first_points(self, hits: Sequence[Hits]) -> FloatArray:
        """Median of the scan points that the sightings' rays meet: (T,3), NaN where none does."""
        points = np.full((len(self.view), 3), np.nan)
        for number, of_view in enumerate(hits):
            mine = self.view == number
            points[mine] = of_view.points[self.feature[mine]]
        return _medians(points, self.track, self.count)


def build_tracks(features: Sequence[Features], matches: Mapping[tuple[int, int], IndexArray]) -> Tracks:
    """Chain matches {(i, j): (M,2)} into tracks; a photo that would see one twice is left out of it."""
    start = np.concatenate([[0], np.cumsum([len(f) for f in features])])
    links = [pairs + start[[i, j]] for (i, j), pairs in matches.items() if len(pairs)]
    ends = np.concatenate(links) if links else np.zeros((0, 2), dtype=np.int64)
    graph = coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(start[-1], start[-1]))
    component = connected_components(graph, directed=False)[1].astype(np.int64)
    node = np.unique(ends)
    order = node[np.argsort(component[node], kind="stable")]
    track = np.unique(component[order], return_inverse=True)[1].astype(np.int64)
    view = np.searchsorted(start, order, side="right") - 1
    feature = order - start[view]
    tracks = Tracks(
        view.astype(np.int64),
        feature.astype(np.int64),
        track,
        _gather([f.pixels for f in features], view, feature, (2,)),
        _gather([f.rays for f in features], view, feature, (3,)),
        _gather([f.to_pixels for f in features], view, feature, (2, 3)),
        np.maximum(1.0, _gather([f.size for f in features], view, feature, ()) / 4.0),
    )
    twice = np.unique(track * len(features) + view, return_inverse=True, return_counts=True)
    return tracks.select(twice[2][twice[1]] == 1)


def _gather(
    arrays: Sequence[FloatArray], view: IndexArray, feature: IndexArray, shape: tuple[int, ...]
) -> FloatArray:
    out = np.empty((len(view), *shape))
    for number, array in enumerate(arrays):
        mine = view == number
        out[mine] = array[feature[mine]]
    return out


def _medians(points: FloatArray, track: IndexArray, count: int) -> FloatArray:
    """Median of the finite points (M,3) of each track (M,), track sorted: (T,3)."""
    out = np.full((count, 3), np.nan)
    finite = np.isfinite(points[:, 0])
    points, track = points[finite], track[finite]
    for axis in range(3):
        order = np.lexsort((points[:, axis], track))
        sorted_track = track[order]
        first = np.flatnonzero(np.r_[True, sorted_track[1:] != sorted_track[:-1]]) if len(order) else order
        length = np.diff(np.append(first, len(order)))
        low, high = first + (length - 1) // 2, first + length // 2
        values = points[order, axis]
        out[sorted_track[first], axis] = 0.5 * (values[low] + values[high])
    return out
