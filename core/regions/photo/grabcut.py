"""GrabCut from a rough outline: solved on a small copy around it, then moved onto the photo's edges.

Source: Rother, Kolmogorov and Blake, GrabCut: interactive foreground extraction using iterated graph cuts,
2004.
"""

from __future__ import annotations

import cv2
import numpy as np

from ...arrays import ArrayLike, BoolArray, ByteArray
from ...errors import RegionError
from ...jobs import Job, Progress, drain
from .edges import as_photo
from .outline import checked_selection, without_specks

_WORKING_SIZE = 400  # pixels of the longer side: a cut takes some 0.1 s
_ITERATIONS = 4


def grab_cut_job(image: ArrayLike, rough: BoolArray, band: float = 0.1) -> Job[BoolArray]:
    """Object near a rough mask (H,W) -> mask (H,W), at full resolution.

    The outline may move by `band` times the rough region's size inwards, and outwards; the rest is taken as
    certain.

    Raises
    ------
    RegionError
        The rough mask does not fit the photo, is too small, or nothing in it stands out from its
        surroundings.
    """
    photo = as_photo(image)
    if rough.shape != photo.shape[:2]:
        raise RegionError("The rough outline is not of the photo's size.")
    checked_selection(rough)
    u, v, columns, rows = cv2.boundingRect(rough.view(np.uint8))
    margin = 2 + round(0.3 * max(columns, rows))
    low = max(u - margin, 0), max(v - margin, 0)
    window = np.s_[low[1] : v + rows + margin, low[0] : u + columns + margin]
    crop, inside = photo[window], rough[window]
    factor = min(1.0, _WORKING_SIZE / max(inside.shape))
    size = max(8, round(inside.shape[1] * factor)), max(8, round(inside.shape[0] * factor))
    small = cv2.resize(crop, size, interpolation=cv2.INTER_AREA)
    labels = _trimap(cv2.resize(inside.view(np.uint8), size, interpolation=cv2.INTER_NEAREST), band)
    found = yield from _cut_job(small.astype(np.uint8), labels)
    soft = cv2.GaussianBlur(found.astype(np.float32), (0, 0), 0.7)
    fine = cv2.resize(soft, inside.shape[::-1], interpolation=cv2.INTER_LINEAR) > 0.5
    out = np.zeros(rough.shape, dtype=np.bool_)
    out[window] = without_specks(fine)
    if not out.any():
        raise RegionError("Nothing in the outline stands out from its surroundings: use the polygon tool.")
    return out


def grab_cut(image: ArrayLike, rough: BoolArray, band: float = 0.1) -> BoolArray:
    """Drain `grab_cut_job`."""
    return drain(grab_cut_job(image, rough, band))


def _trimap(inside: ByteArray | cv2.typing.MatLike, band: float) -> ByteArray:
    """Certain object well inside a rough mask, certain background well outside, in between to be found out.

    A rim of twice the `band` inside begins as background: a loose outline holds some, and colours that the
    object's model has learnt once it does not forget.
    """
    mask = np.asarray(inside, dtype=np.uint8)
    width = max(2.0, band * float(np.sqrt(np.count_nonzero(mask))))
    within = cv2.distanceTransform(mask, cv2.DIST_L2, 5)
    beyond = cv2.distanceTransform(1 - mask, cv2.DIST_L2, 5)
    labels = np.where(beyond > width, cv2.GC_BGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[within > min(2 * width, 0.7 * float(within.max()))] = cv2.GC_FGD
    return labels


def _cut_job(small: ByteArray, labels: ByteArray) -> Job[BoolArray]:
    background, foreground = np.zeros((1, 65)), np.zeros((1, 65))
    mode = cv2.GC_INIT_WITH_MASK
    cv2.setRNGSeed(0)  # the colour clusters start at random: the same outline shall give the same region
    for iteration in range(_ITERATIONS):
        yield Progress(iteration / _ITERATIONS, "Separating the region from its surroundings")
        try:
            cv2.grabCut(small, labels, (0, 0, 1, 1), background, foreground, 1, mode)
        except cv2.error as error:  # no certain pixels on one side
            raise RegionError("The rough outline fills the whole photo: draw it more closely.") from error
        mode = cv2.GC_EVAL
    found: BoolArray = (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)
    return found
