"""What does not belong to the scan: people, vehicles, glare, seen in one photo and not in the others.

Each photo is compared with the median of all photos on every face. Misplaced detail makes such differences
alternate in sign and average out over a small area; a stranger does not. So differences are averaged in the
photo's plane first, with their sign, and an area that still differs is not used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import BoolArray, ByteArray, Float32Array, FloatArray, IndexArray
from ...cameras.base import Camera
from ...jobs import Job, Progress, part
from .candidates import CandidateTable
from .parallel import CORES, map_ahead

_CELLS = 96
"""Cells along the photo's longer side in which differences are averaged."""
_LEAST = 0.07
"""Difference (of sRGB 1) that is never called foreign: lighting, glossy paint."""
_TIMES_USUAL = 5.0
_ROWS = 50_000
"""Faces whose medians one thread finds at once."""


@dataclass(frozen=True, eq=False)
class Consensus:
    """Median colour of each face over all its photos: `colour` (F,3) uint8; `count` (F,) photos."""

    colour: ByteArray
    count: IndexArray


def consensus_job(table: CandidateTable, colours: ByteArray) -> Job[Consensus]:
    """Median of the gain-corrected colours (F,K,3) of each face; the lower one of the middle two."""
    filled = table.filled
    count = np.count_nonzero(filled, axis=1)
    middle = np.zeros((len(colours), 3), dtype=np.uint8)

    def median(start: int) -> ByteArray:
        rows = slice(start, start + _ROWS)
        known = np.where(filled[rows, :, None], colours[rows], np.uint8(255))
        ordered = np.sort(np.ascontiguousarray(known.transpose(0, 2, 1)), axis=2)
        at = np.maximum(count[rows] - 1, 0) // 2
        lower: ByteArray = np.take_along_axis(ordered, at[:, None, None], axis=2)[..., 0]
        return lower

    starts = range(0, len(colours), _ROWS)
    medians = map_ahead(median, starts, CORES)
    for start in starts:
        yield Progress(start / len(colours), "Comparing the photos' contents")
        middle[start : start + _ROWS] = next(medians)
    return Consensus(middle, count)


def foreign_candidates(
    table: CandidateTable, colours: ByteArray, agreed: Consensus, view: int, camera: Camera
) -> tuple[IndexArray, IndexArray]:
    """Faces and slots where photo `view` shows something that the other photos do not: (n,), (n,).

    Only faces with three photos or more tell which one is wrong; a foreign area found by them takes faces
    with two photos along. No face loses its last photo.
    """
    face, slot = table.of_view(view)
    judged = agreed.count[face] >= 3
    if np.count_nonzero(judged) < 20:
        return face[:0], slot[:0]
    cell = max(camera.width, camera.height) / _CELLS
    shape = int(np.ceil(camera.height / cell)), int(np.ceil(camera.width / cell))
    pixel = table.pixel[face, slot]
    row = np.minimum((pixel[:, 1] / cell).astype(np.int64), shape[0] - 1)
    column = np.minimum((pixel[:, 0] / cell).astype(np.int64), shape[1] - 1)
    difference = colours[face, slot].astype(np.float32) - agreed.colour[face]
    level = _smoothed(difference[judged] / np.float32(255), row[judged], column[judged], shape)
    known = np.isfinite(level)
    limit = max(_LEAST, _TIMES_USUAL * float(np.median(level[known])))
    foreign = _grown(known & (level > limit), known & (level > 0.5 * limit))
    chosen = foreign[row, column] & (agreed.count[face] >= 2)
    return face[chosen], slot[chosen]


def _smoothed(
    difference: Float32Array, row: IndexArray, column: IndexArray, shape: tuple[int, int]
) -> Float32Array:
    """Length of the signed mean difference (n,3) per cell and its neighbours: (rows, columns), NaN: none."""
    cell = row * shape[1] + column
    size = shape[0] * shape[1]
    count = np.bincount(cell, minlength=size).reshape(shape).astype(np.float32)
    weight = cv2.GaussianBlur(count, (0, 0), 0.8)
    square = np.zeros(shape, np.float32)
    for channel in range(3):
        total = np.bincount(cell, difference[:, channel], size).reshape(shape).astype(np.float32)
        mean = cv2.GaussianBlur(total, (0, 0), 0.8) / np.maximum(weight, 1e-6)
        square += mean * mean
    return np.where(weight > 0.2, np.sqrt(square / 3), np.nan).astype(np.float32)


def _grown(core: BoolArray, candidate: BoolArray) -> BoolArray:
    """Connected areas of `candidate` that hold a cell of `core`, and one cell around."""
    count, label = cv2.connectedComponents(candidate.astype(np.uint8), connectivity=8)
    hit = np.zeros(count, dtype=np.bool_)
    hit[label[core]] = True
    hit[0] = False
    grown: BoolArray = cv2.dilate(hit[label].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return grown


def drop_foreign_job(table: CandidateTable, cameras: Sequence[Camera], colours: ByteArray) -> Job[FloatArray]:
    """Empty the slots that show what other photos do not; -> share of each photo's faces (V,)."""
    agreed = yield from part(consensus_job(table, colours), 0.0, 0.4)
    total = np.bincount(table.view[table.filled], minlength=len(cameras))
    judged = map_ahead(
        lambda number: foreign_candidates(table, colours, agreed, number, cameras[number]),
        range(len(cameras)),
        CORES,
    )
    found = []
    for number in range(len(cameras)):
        yield Progress(0.4 + 0.6 * number / len(cameras), "Comparing the photos' contents")
        found.append(next(judged))
    for face, slot in found:
        # Where all photos of a face were found foreign to one another, they stay.
        left = np.count_nonzero(table.filled[face], axis=1) > 1
        table.drop(face[left], slot[left])
    share: FloatArray = np.array([len(face) for face, _ in found]) / np.maximum(total, 1)
    return share
