"""The colour chart with 24 patches (ColorChecker Classic): found in a photo, or from four corners.

Squares of alike size that lie in a grid make a candidate; which patch is which, and whether it is the chart
at all, is decided by its colours: no other pattern turns into the published ones by a 3 x 3 matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import ArrayLike, BoolArray, ByteArray, FloatArray, IndexArray
from ...errors import PhotoError
from ..views.images import to_linear
from .chart_squares import find_grids, find_squares, fit_homography
from .difference import colour_difference, lab_to_linear, linear_to_lab

COLUMNS, ROWS = 6, 4
REFERENCE = np.array(
    [
        *((37.986, 13.555, 14.059), (65.711, 18.130, 17.810), (49.927, -4.880, -21.925)),
        *((43.139, -13.095, 21.905), (55.112, 8.844, -25.399), (70.719, -33.397, -0.199)),
        *((62.661, 36.067, 57.096), (40.020, 10.410, -45.964), (51.124, 48.239, 16.248)),
        *((30.325, 22.976, -21.587), (72.532, -23.709, 57.255), (71.941, 19.363, 67.857)),
        *((28.778, 14.179, -50.297), (55.261, -38.342, 31.370), (42.101, 53.378, 28.190)),
        *((81.733, 4.039, 79.819), (51.935, 49.986, -14.574), (51.038, -28.631, -28.638)),
        *((96.539, -0.425, 1.186), (81.257, -0.638, -0.335), (66.766, -0.734, -0.504)),
        *((50.867, -0.153, -0.270), (35.656, -0.421, -1.231), (20.461, -0.079, -0.973)),
    ]
)
"""L*a*b* (D50) of the patches, row by row from dark skin to black, as the maker published them."""
_FIELD = 0.43
"""Half the side of a patch in units of the distance between patches."""
_INNER = 0.22
"""Half the side of the part of a patch that is measured: its rim mixes with the frame."""
_SAMPLES = 13
_WORKING_SIZE = 1600
_MOST_DIFFERENT = 7.0
"""Mean CIEDE2000 left by the best matrix above which it is not the chart: others leave 12 or more."""
_CLEARER = 1.6
"""How much worse the next best reading of the patches must be."""
_ROUGHEST = 0.25
"""Largest median of the patches' own variation (relative): patches are plain."""
_DARKEST, _BRIGHTEST = 2, 250


@dataclass(frozen=True, eq=False)
class ColourChart:
    """A chart in a photo: `corners` (4,2) pixels of the field, at dark skin, bluish green, black, white.

    `centre` (24,2) pixels and `colour` (24,3) linear RGB of the patches in the order of `REFERENCE`; `usable`
    (24,) where neither burnt out nor in the dark.
    """

    corners: FloatArray
    centre: FloatArray
    colour: FloatArray
    usable: BoolArray


def find_colour_chart(photo: ByteArray, corners: ArrayLike | None = None) -> ColourChart:
    """Find the chart in a photo (H,W,3) uint8 RGB, at any angle; `corners` (4,2) pixels help, in any order.

    Given corners are those of the field of patches, to a few pixels; they are refined. Raises PhotoError when
    no chart is found or the patches can be read in more than one way.
    """
    scale = min(1.0, _WORKING_SIZE / max(photo.shape[:2]))
    small = cv2.resize(photo, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else photo
    squares = find_squares(np.asarray(small, dtype=np.uint8))
    if corners is None:
        grids = find_grids(squares.centre, squares.side, (COLUMNS, ROWS))
        maps = [m for grid in grids for m in _placements(grid.homography, grid.low, grid.high)]
    else:
        given = _ordered(np.asarray(corners, dtype=np.float64)) * scale
        maps = [_refined(_turned(given, turn), squares.centre) for turn in range(4)]
    found = _best_reading(np.asarray(small, dtype=np.uint8), maps)
    if found is None:
        raise PhotoError(
            "No colour chart was found in the photo: it must be whole, flat, evenly lit and at least "
            "100 pixels wide. Mark the four corners of its field of patches."
        )
    refined = _refined(found, squares.centre)
    to_full = np.array([[1 / scale, 0, 0.5 / scale - 0.5], [0, 1 / scale, 0.5 / scale - 0.5], [0, 0, 1]])
    return _measured(photo, to_full @ refined)


def _placements(homography: FloatArray, low: IndexArray, high: IndexArray) -> list[FloatArray]:
    """All ways to lay the chart over a grid of squares: maps (3,3) from patch column and row to pixels."""
    maps = []
    for turn in range(4):
        columns, rows = (COLUMNS, ROWS) if turn % 2 == 0 else (ROWS, COLUMNS)
        rotate = _quarter_turns(turn)
        for left in range(int(high[0]) - columns + 1, int(low[0]) + 1):
            for top in range(int(high[1]) - rows + 1, int(low[1]) + 1):
                shift = np.array([[1.0, 0, left], [0, 1, top], [0, 0, 1]])
                maps.append(homography @ shift @ rotate)
    return maps


def _quarter_turns(turn: int) -> FloatArray:
    """Map from the chart's patch indices to those of the grid cells it covers, `turn` quarters round."""
    width, height = COLUMNS - 1, ROWS - 1
    turned = [
        [[1, 0, 0], [0, 1, 0]],
        [[0, -1, height], [1, 0, 0]],
        [[-1, 0, width], [0, -1, height]],
        [[0, 1, 0], [-1, 0, width]],
    ][turn]
    return np.array([*turned, [0, 0, 1]], dtype=np.float64)


def _best_reading(photo: ByteArray, maps: list[FloatArray]) -> FloatArray | None:
    """The map whose colours are the chart's, None when none is, or two that differ are."""
    scored = sorted(
        ((_mismatch(photo, homography), number) for number, homography in enumerate(maps)),
    )
    if not scored or scored[0][0] > _MOST_DIFFERENT:
        return None
    best = maps[scored[0][1]]
    pitch = float(np.linalg.norm(np.diff(_pixels(best)[:2], axis=0)))
    for score, number in scored[1:]:
        if score > _CLEARER * scored[0][0]:
            break
        if np.abs(_pixels(maps[number]) - _pixels(best)).max() > 0.5 * pitch:
            return None
    return best


def _mismatch(photo: ByteArray, homography: FloatArray) -> float:
    """Mean CIEDE2000 between the patches, after the best 3 x 3 matrix, and the chart; inf if impossible."""
    pixels = _pixels(homography)
    height, width = photo.shape[:2]
    if not (np.isfinite(pixels).all() and (pixels > 0).all() and (pixels < (width - 1, height - 1)).all()):
        return float("inf")
    colour, variation, usable = _patches(photo, homography)
    if np.count_nonzero(usable) < 12 or float(np.median(variation)) > _ROUGHEST:
        return float("inf")
    true = lab_to_linear(REFERENCE)
    weight = 1 / (0.05 + true.mean(axis=1, keepdims=True))[usable]
    matrix = np.linalg.lstsq(weight * colour[usable], weight * true[usable], rcond=None)[0]
    return float(np.mean(colour_difference(linear_to_lab(colour[usable] @ matrix), REFERENCE[usable])))


def _indices() -> FloatArray:
    """Column and row of each patch: (24,2)."""
    column, row = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    indices: FloatArray = np.stack([column.ravel(), row.ravel()], axis=1).astype(np.float64)
    return indices


def _apply(homography: FloatArray, points: FloatArray) -> FloatArray:
    mapped: FloatArray = np.asarray(cv2.perspectiveTransform(points[None], homography)[0], dtype=np.float64)
    return mapped


def _pixels(homography: FloatArray) -> FloatArray:
    """Centres of the patches: (24,2)."""
    return _apply(homography, _indices())


def _patches(photo: ByteArray, homography: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Median linear colour (24,3) of the patches, its relative variation (24,), and where it can be used."""
    step = np.linspace(-_INNER, _INNER, _SAMPLES)
    offset = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
    places = (_indices()[:, None] + offset).reshape(-1, 2)
    pixel = _apply(homography, places).astype(np.float32).reshape(len(_indices()), -1, 2)
    values = cv2.remap(
        photo, pixel[..., 0], pixel[..., 1], cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE
    )
    linear = to_linear(values).astype(np.float64)
    colour = np.median(linear, axis=1)
    spread = np.median(np.abs(linear - colour[:, None]), axis=1).mean(axis=1)
    middle = np.median(values, axis=1)
    usable: BoolArray = (middle.max(axis=1) <= _BRIGHTEST) & (middle.max(axis=1) >= _DARKEST)
    return colour, spread / (colour.mean(axis=1) + 0.01), usable


def _measured(photo: ByteArray, homography: FloatArray) -> ColourChart:
    colour, _, usable = _patches(photo, homography)
    low, right, bottom = -_FIELD, COLUMNS - 1 + _FIELD, ROWS - 1 + _FIELD
    corners = _apply(homography, np.array([[low, low], [right, low], [right, bottom], [low, bottom]]))
    return ColourChart(corners, _pixels(homography), colour, usable)


def _ordered(corners: FloatArray) -> FloatArray:
    """Four corners clockwise as seen in the photo. Raises PhotoError when they span no area."""
    if corners.shape != (4, 2) or not np.isfinite(corners).all():
        raise PhotoError("A colour chart is marked by the four corners of its field of patches.")
    around = corners - corners.mean(axis=0)
    clockwise = corners[np.argsort(np.arctan2(around[:, 1], around[:, 0]), kind="stable")]
    if cv2.contourArea(clockwise.astype(np.float32)) < 400:
        raise PhotoError(
            "The four corners of the colour chart span less than 20 x 20 pixels: mark them anew."
        )
    return clockwise


def _turned(corners: FloatArray, turn: int) -> FloatArray:
    """Map (3,3) from patch indices to pixels that starts at corner `turn` of the clockwise ones."""
    low, right, bottom = -_FIELD, COLUMNS - 1 + _FIELD, ROWS - 1 + _FIELD
    field = np.array([[low, low], [right, low], [right, bottom], [low, bottom]], dtype=np.float32)
    target = np.roll(corners, -turn, axis=0).astype(np.float32)
    return np.asarray(cv2.getPerspectiveTransform(field, target), dtype=np.float64)


def _refined(homography: FloatArray, centres: FloatArray) -> FloatArray:
    """The map made to go through the squares (n,2) found near the patches; as it is with fewer than eight."""
    for _ in range(2):
        pixels = _pixels(homography)
        pitch = float(np.linalg.norm(np.diff(pixels[:2], axis=0)))
        if len(centres) == 0 or not np.isfinite(pixels).all():
            return homography
        distance = np.linalg.norm(pixels[:, None] - centres, axis=2)
        near = np.flatnonzero(distance.min(axis=1) < 0.25 * pitch)
        if len(near) < 8:
            return homography
        matched = centres[np.argmin(distance[near], axis=1)]
        through = fit_homography(_indices()[near], matched, max(0.06 * pitch, 1.0))
        if through is None:
            return homography
        homography = through[0]
    return homography
