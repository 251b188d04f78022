"""Do the poses agree? Small pieces of each photo are looked for in its neighbours, carried over by the scan.

A photo whose pieces lie elsewhere in every neighbour is posed wrong; its shift in pixels is the pose error as
it would show in the texture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import BoolArray, ByteArray, Float32Array, FloatArray, IndexArray
from ...jobs import Job, Progress
from ...photos.view import View
from ..surface import Surface
from .candidates import CandidateTable
from .images import sample_image, view_name
from .parallel import CORES, map_ahead
from .visibility import project

PREVIEW_WIDTH = 800
"""Width (pixels) of the reduced photos in which poses are compared."""
_PARTNERS = 5
_TILE = 33
_SEARCH = 24
"""Pixels of the preview in which a piece is looked for: about 2 degrees of a normal lens."""
_TILES = 12
"""Pieces compared per pair of photos."""
_GRID: IndexArray = np.stack(np.meshgrid(*[np.arange(_TILE) - _TILE // 2] * 2), axis=-1).reshape(-1, 2)
"""Offsets of a piece's pixels from its centre, row by row."""
_CORNERS = [0, _TILE - 1, _TILE * (_TILE - 1), _TILE * _TILE - 1]
_FEWEST = 8
"""Pieces that must be looked for before their absence says anything."""
_FACES = 40_000
_MATCH = 0.65
"""Normalised correlation from which a piece counts as found."""
_LEAST_CONTRAST = 6.0
"""Standard deviation (grey levels) below which a piece is too plain to be found again."""
_SCALE_RANGE = 2.2
"""Pieces that another photo shows so many times smaller or larger, in any direction, are not compared."""
_SMALLEST_SHIFT = 1.5
"""Shift (preview pixels) that is never called a wrong pose: the scan's own roughness causes as much."""
_TIMES_USUAL = 5.0
"""A pose is wrong from so many times the usual shift."""


@dataclass(frozen=True, eq=False)
class Preview:
    """A reduced grey photo and its scale."""

    grey: ByteArray
    scale: float

    @classmethod
    def of_photo(cls, photo: ByteArray, scale: float = 1.0) -> Preview:
        """Reduce a photo (H,W,3), itself read at `scale`, to about `PREVIEW_WIDTH` pixels."""
        factor = min(1.0, PREVIEW_WIDTH / max(photo.shape[:2]))
        grey = cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY)
        small = cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
        return cls(small.astype(np.uint8, copy=False), factor * scale)

    def pixels(self, full: FloatArray) -> FloatArray:
        """Pixels of the full photo in the preview."""
        return (full + 0.5) * self.scale - 0.5


@dataclass(frozen=True)
class PoseAgreement:
    """How a photo agrees with its neighbours.

    `shift` is the median distance (pixels of the full photo) between where the pose puts a detail and where
    it is, NaN where nothing could be compared; `matched` the share of pieces found; `wrong` the verdict.
    """

    shift: float
    matched: float
    wrong: bool


def compare_poses_job(
    surface: Surface, views: Sequence[View], previews: Sequence[Preview | None], table: CandidateTable
) -> Job[list[PoseAgreement]]:
    """Look for pieces of every photo in the photos that share most faces with it: -> [PoseAgreement]."""
    shared = shared_faces(table, len(views))
    pairs = _Pairs.empty(len(views))

    def check(number: int) -> list[tuple[int, _Comparison]]:
        partners = [int(j) for j in np.argsort(-shared[number], kind="stable") if shared[number, j] > 0]
        return _compare_with(surface, views, previews, number, partners[:_PARTNERS])

    checked = map_ahead(check, range(len(views)), CORES)
    for number, view in enumerate(views):
        yield Progress(number / len(views), f"Checking the pose of {view_name(view, number)}")
        for j, comparison in next(checked):
            pairs.enter(number, j, comparison)
    return _verdicts(pairs, np.array([1.0 if p is None else p.scale for p in previews]))


def shared_faces(table: CandidateTable, view_count: int) -> IndexArray:
    """Number of (sampled) faces that two photos both see: (V,V), 0 on the diagonal."""
    rows = table.view[:: max(1, len(table.view) // _FACES)].astype(np.int64)
    count = np.zeros(view_count * view_count, dtype=np.int64)
    for a in range(table.slots):
        for b in range(table.slots):
            both = (rows[:, a] >= 0) & (rows[:, b] >= 0) & (a != b)
            count += np.bincount(rows[both, a] * view_count + rows[both, b], minlength=len(count))
    return count.reshape(view_count, view_count)


@dataclass(frozen=True)
class _Comparison:
    """Pieces `tried` in another photo, and the distances (preview pixels) at which they were `found`."""

    tried: int
    found: list[float]


def _compare_with(
    surface: Surface,
    views: Sequence[View],
    previews: Sequence[Preview | None],
    number: int,
    partners: Sequence[int],
) -> list[tuple[int, _Comparison]]:
    """Look for pieces of a photo in its partners: each partner and what was found."""
    view, preview = views[number], previews[number]
    if preview is None:
        return []
    centre = _pieces(preview)
    corners = _on_surface(surface, view, preview, centre, _GRID[_CORNERS])
    others = [(j, views[j], small) for j in partners if (small := previews[j]) is not None]
    shown = [_shown_whole(corners, other, small)[:_TILES] for _, other, small in others]
    needed = np.unique(np.concatenate([np.zeros(0, np.int64), *shown]))
    points = _on_surface(surface, view, preview, centre[needed], _GRID)  # rays for no others
    found = []
    for (j, other, small), chosen in zip(others, shown, strict=True):
        of_them = points[np.searchsorted(needed, chosen)]
        found.append((j, _compare(surface, preview, centre[chosen], of_them, other, small)))
    return found


def _pieces(preview: Preview) -> IndexArray:
    """Centres (T,2) pixels of squares across a preview, those with most detail in every direction first."""
    margin = _TILE // 2 + _SEARCH
    rows, columns = preview.grey.shape
    if min(rows, columns) <= 2 * margin + 2:
        return np.zeros((0, 2), np.int64)
    strength = cv2.cornerMinEigenVal(cv2.GaussianBlur(preview.grey, (0, 0), 1.5), _TILE)
    u = np.linspace(margin, columns - 1 - margin, 8).astype(np.int64)
    v = np.linspace(margin, rows - 1 - margin, 6).astype(np.int64)
    centre = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    strongest: IndexArray = centre[np.argsort(-strength[centre[:, 1], centre[:, 0]], kind="stable")]
    return strongest


def _on_surface(
    surface: Surface, view: View, preview: Preview, centre: IndexArray, offsets: IndexArray
) -> FloatArray:
    """Surface points (T,N,3) m that pieces show at offsets (N,2) from their centres (T,2); NaN off it."""
    pixel = centre[:, None] + offsets
    full = (pixel.reshape(-1, 2) + 0.5) / preview.scale - 0.5
    rays = view.camera.unproject(full) @ np.asarray(view.rotation)
    hits = surface.caster.first_hit(view.centre - surface.origin, rays)
    with np.errstate(invalid="ignore"):
        points = view.centre + rays * hits.distance[:, None]
    points[~np.isfinite(points).all(axis=1)] = np.nan
    return points.reshape(len(centre), len(offsets), 3)


def _shown_whole(corners: FloatArray, other: View, preview: Preview) -> IndexArray:
    """Pieces, by their corners (T,4,3) m, that another photo shows whole and about as large: (n,)."""
    pixels = project(other, corners.reshape(-1, 3))
    whole = other.camera.in_frame(pixels).reshape(-1, 4).all(axis=1)
    return np.flatnonzero(whole & _comparable(pixels.reshape(-1, 4, 2) * preview.scale))


def _compare(
    surface: Surface,
    preview: Preview,
    centre: IndexArray,
    points: FloatArray,
    other: View,
    other_preview: Preview,
) -> _Comparison:
    """Look for pieces with centres (T,2) and surface points (T,TILE*TILE,3) by what another photo shows."""
    if len(centre) == 0:
        return _Comparison(0, [])
    flat = points.reshape(-1, 3)
    pixels = project(other, flat)
    usable = other.camera.in_frame(pixels)
    usable[usable] = ~surface.caster.occluded(other.centre - surface.origin, flat[usable] - surface.origin)
    values = sample_image(other_preview.grey, np.nan_to_num(other_preview.pixels(pixels)))
    values = values.reshape(len(centre), _TILE, _TILE)
    contrast = values.std(axis=(1, 2))
    tried = np.flatnonzero(usable.reshape(len(centre), -1).all(axis=1) & (contrast >= _LEAST_CONTRAST))
    found = [_found_at(preview.grey, centre[tile], values[tile]) for tile in tried]
    return _Comparison(len(tried), [distance for distance in found if distance is not None])


def _comparable(corners: FloatArray) -> BoolArray:
    """Pieces that another photo shows about as large: corners (T,4,2) preview pixels there -> (T,)."""
    along = (corners[:, 1] - corners[:, 0] + corners[:, 3] - corners[:, 2]) / (2 * (_TILE - 1))
    down = (corners[:, 2] - corners[:, 0] + corners[:, 3] - corners[:, 1]) / (2 * (_TILE - 1))
    singular = np.linalg.svd(np.nan_to_num(np.stack([along, down], axis=1)), compute_uv=False)
    comparable: BoolArray = (singular[:, 1] > 1 / _SCALE_RANGE) & (singular[:, 0] < _SCALE_RANGE)
    return comparable


def _found_at(grey: ByteArray, centre: IndexArray, piece: ByteArray) -> float | None:
    """Distance (pixels) from `centre` at which `piece` is found in a photo, None if it is not."""
    reach = _TILE // 2 + _SEARCH
    u, v = int(centre[0]), int(centre[1])
    window = grey[v - reach : v + reach + 1, u - reach : u + reach + 1]
    score: Float32Array = cv2.matchTemplate(window, piece, cv2.TM_CCOEFF_NORMED).astype(np.float32)
    row, column = np.unravel_index(int(np.argmax(score)), score.shape)
    if score[row, column] < _MATCH:
        return None
    return float(np.hypot(row - _SEARCH, column - _SEARCH))


@dataclass(frozen=True, eq=False)
class _Pairs:
    """What comparing photos i and j gave, (V,V) each: pieces `tried`, `found`, and the median `distance`."""

    tried: IndexArray
    found: IndexArray
    distance: FloatArray

    @classmethod
    def empty(cls, count: int) -> _Pairs:
        counts = np.zeros((2, count, count), dtype=np.int64)
        return cls(counts[0], counts[1], np.full((count, count), np.nan))

    def enter(self, i: int, j: int, comparison: _Comparison) -> None:
        self.tried[i, j], self.found[i, j] = comparison.tried, len(comparison.found)
        if len(comparison.found) >= 2:
            self.distance[i, j] = np.median(comparison.found)

    def both_ways(self) -> FloatArray:
        """Distance of each pair, from the pieces of either or both: symmetric, NaN where neither has any."""
        there, back = self.distance, self.distance.T
        mean = 0.5 * (there + back)
        return np.where(np.isnan(mean), np.where(np.isnan(there), back, there), mean)


def _verdicts(pairs: _Pairs, scales: FloatArray) -> list[PoseAgreement]:
    """Judge the photos by what is usual among all, the most contradicted one first.

    Whom most of its neighbours contradict is wrong; it no longer counts when the others are judged, so that
    a photo is not condemned for disagreeing with a wrong one.
    """
    distance = pairs.both_ways()
    known = np.isfinite(distance)
    # A low percentile: pairs with wrong photos must not set the scale.
    typical = float(np.percentile(distance[known], 30)) if known.any() else 0.0
    limit = max(_SMALLEST_SHIFT, _TIMES_USUAL * typical)
    share = pairs.found.sum(axis=1) / np.maximum(pairs.tried.sum(axis=1), 1)
    judged = pairs.tried.sum(axis=1) >= _FEWEST
    usual = float(np.median(share[judged])) if judged.any() else 0.0
    wrong = judged & (share < 0.3 * usual) & (usual > 0.5)
    shift = np.array([_lower_median(row[np.isfinite(row)]) for row in distance])
    while True:
        counts = known & ~wrong  # neighbours that still count, per row
        contradicts = counts & (distance > limit)
        against = np.count_nonzero(contradicts, axis=1)
        for_it = np.count_nonzero(counts, axis=1) - against
        # Of two photos that have only each other, none can be called wrong.
        sure = (against >= 2) | (contradicts & (for_it > 0)).any(axis=1)
        suspect = ~wrong & (against > for_it) & sure
        if not suspect.any():
            break
        worst = np.lexsort((np.nan_to_num(shift), against - for_it, suspect))[-1]
        shift[worst] = _lower_median(distance[worst][counts[worst]])
        wrong[worst] = True
    for number in np.flatnonzero(~wrong):
        shift[number] = _lower_median(distance[number][counts[number]])
    share = np.where(judged, share, np.nan)
    rows = zip(shift / scales, share, wrong, strict=True)
    return [PoseAgreement(float(pixels), float(matched), bool(bad)) for pixels, matched, bad in rows]


def _lower_median(values: FloatArray) -> float:
    return float(np.sort(values)[(len(values) - 1) // 2]) if len(values) else float("nan")
