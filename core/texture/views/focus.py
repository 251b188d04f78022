"""How sharp each photo is on the surface, as a function of distance.

Detail in a photo depends on what it shows: a plain wall is not out of focus, nor a gravel path in focus. So
photos are compared on the same patch of the surface and at the same wavelength on it. A photo that lacks
detail which others find there is blurred; how the lack grows towards short wavelengths gives the blur's
size in pixels. Per photo the blur is fitted as a function of distance: the circle of confusion of a lens is
linear in 1/distance - 1/focus distance, motion blur adds a constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import AnyArray, BoolArray, ByteArray, Float32Array, FloatArray, IndexArray
from .images import sample_image
from .visibility import VisibleFaces

LEVELS = 4
_CELL = 16
"""Side of the windows (pixels of the analysed photo) in which detail is averaged."""
_QUIETEST = 2.0
"""Percentile of the finest detail that counts as noise: smooth places hold nothing else."""
_CONTRAST = 0.5
"""Largest difference in log energy that is put down to exposure and flare."""
_ROUNDING = 0.1
"""Variance (grey levels²) that rounding to whole numbers causes."""
_FREQUENCY = 2 * np.pi * 0.30 / 2.0 ** np.arange(LEVELS)
"""Typical angular frequency (rad/pixel) of the detail of each level, Haar octaves."""
_OWN_BLUR = 0.7
"""Blur (sigma, pixels) that every photo has from its pixels; blur below it costs nothing."""
_WORST_BLUR = 8.0


@dataclass(frozen=True, eq=False)
class PatchDetail:
    """Detail that one photo shows on n patches of the surface.

    `patch` (n,) numbers; `octave` (n,) log2 of the texel size (m) of the analysed photo; `detail` (n,LEVELS)
    log of the relative variance at each level, an upper bound where `shown` (n,LEVELS) is false because it
    drowns in noise; `nearness` (n,) 1/m.
    """

    patch: IndexArray
    octave: FloatArray
    detail: FloatArray
    shown: BoolArray
    nearness: FloatArray


def no_detail() -> PatchDetail:
    """Return the detail of a photo that sees nothing."""
    levels = np.zeros((0, LEVELS))
    return PatchDetail(np.zeros(0, np.int64), np.zeros(0), levels, levels > 0, np.zeros(0))


def detail_grids(photo: ByteArray) -> Float32Array:
    """Variance of each Haar octave relative to the local brightness: (H,W,3) -> (rows,columns,LEVELS + 1).

    In a 2 x 2 block the energies of the three detail bands LH, HL, HH add up to the variance of its pixels.
    The last layer is that of white noise at the finest level, found where the photo is smoothest.
    """
    grey: AnyArray = cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY).astype(np.float32)
    rows, columns = max(1, grey.shape[0] // _CELL), max(1, grey.shape[1] // _CELL)
    brightness = cv2.resize(grey, (columns, rows), interpolation=cv2.INTER_AREA)
    grids = np.zeros((rows, columns, LEVELS + 1), dtype=np.float32)
    noise = 0.0
    for level in range(LEVELS):
        if min(grey.shape) < 2 * _CELL:
            break
        even = grey[: grey.shape[0] // 2 * 2, : grey.shape[1] // 2 * 2]
        half = (even.shape[1] // 2, even.shape[0] // 2)
        mean = cv2.resize(even, half, interpolation=cv2.INTER_AREA)
        square = cv2.resize(even * even, half, interpolation=cv2.INTER_AREA)
        energy = cv2.resize(square - mean * mean, (columns, rows), interpolation=cv2.INTER_AREA)
        if level == 0:
            noise = max(float(np.percentile(energy, _QUIETEST)), _ROUNDING)
        grids[..., level] = energy / (brightness + 4) ** 2
        grey = mean
    grids[..., LEVELS] = noise / (brightness + 4) ** 2
    return grids


def patch_detail(photo: ByteArray, scale: float, seen: VisibleFaces, patch_size: int) -> PatchDetail:
    """Detail on the patches (runs of `patch_size` faces) that a photo read at `scale` sees."""
    grids = detail_grids(photo)
    per_pixel = scale * np.array([grids.shape[1] / photo.shape[1], grids.shape[0] / photo.shape[0]])
    centre = (seen.centre + 0.5) * per_pixel - 0.5
    values = sample_image(grids, centre).astype(np.float64)
    number = seen.face // patch_size  # ascending, as faces are
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    patch, count = number[starts], np.diff(np.append(starts, len(number)))

    def mean(of: AnyArray) -> FloatArray:
        of_patch: FloatArray = np.add.reduceat(of, starts, dtype=np.float64) / count
        return of_patch

    detail = np.stack([mean(values[:, level]) for level in range(LEVELS)], axis=1)
    # Averaging 2 x 2 pixels quarters the variance of white noise.
    noise = mean(values[:, LEVELS])[:, None] / 4.0 ** np.arange(LEVELS)
    shown = detail > 4 * noise
    log = np.log(np.maximum(np.where(shown, detail - noise, 3 * noise), 1e-12))
    return PatchDetail(patch, mean(np.log2(seen.texel / scale)), log, shown, mean(1.0 / seen.distance))


@dataclass(frozen=True, eq=False)
class FocusModel:
    """Blur of one photo: `sigma² = c0 + c1 x + c2 x²` (pixels²), x = 1/distance (1/m) within `span`.

    Beyond the span it stays as it is at its end, or grows as `lens` does, the blur that the lens's settings
    cause.
    """

    coefficients: FloatArray
    span: tuple[float, float] = (0.0, np.inf)
    lens: FocusModel | None = None

    def blur(self, distance: AnyArray) -> FloatArray:
        """Sigma in pixels of the photo at distances (m)."""
        x = 1.0 / np.asarray(distance, dtype=np.float64)
        known: FloatArray = np.clip(x, *self.span)
        squared = self._squared(known)
        if self.lens is not None:
            squared = squared + np.maximum(self.lens._squared(x) - self.lens._squared(known), 0)
        sigma: FloatArray = np.sqrt(np.clip(squared, 0, _WORST_BLUR**2))
        return sigma

    def _squared(self, x: FloatArray) -> FloatArray:
        c = self.coefficients
        squared: FloatArray = np.maximum(c[0] + c[1] * x + c[2] * x * x, 0)
        return squared

    def lost_octaves(self, distance: AnyArray) -> FloatArray:
        """Octaves of resolution that the blur costs at distances (m)."""
        lost: FloatArray = 0.5 * np.log2(1 + (self.blur(distance) / _OWN_BLUR) ** 2)
        return lost


def fit_focus(
    details: list[PatchDetail], scales: FloatArray, lenses: Sequence[FocusModel | None] | None = None
) -> list[FocusModel]:
    """Blur of every photo from what all show on the same patches; `scales` (V,) of the analysed photos.

    `lenses` are what the lens's settings say, where they are known: they stand for photos that share too
    little with others, and for distances at which nothing was compared.
    """
    missing = _missing_detail(details)
    return [
        _fit_photo(detail, lack, float(scale), lens)
        for detail, lack, scale, lens in zip(
            details, missing, scales, lenses or [None] * len(details), strict=True
        )
    ]


def _missing_detail(details: list[PatchDetail]) -> list[FloatArray]:
    """Log energy that each photo lacks against the others, per patch and level: [(n,LEVELS)], NaN unknown.

    Detail is compared per octave of wavelength on the surface. With three
    photos or more the yardstick is the mean of the two highest values of the patch and octave, so that a
    glossy or noisy one does not set it alone.
    """
    if not details:
        return []
    lowest = int(np.floor(min(d.octave.min(initial=0) for d in details))) - 1
    highest = int(np.ceil(max(d.octave.max(initial=0) for d in details))) + LEVELS + 1
    octaves = highest - lowest + 1
    patches = max((int(d.patch.max(initial=0)) for d in details), default=0) + 1
    first = np.full((patches, octaves), -np.inf)
    second = np.full((patches, octaves), -np.inf)
    count = np.zeros((patches, octaves), dtype=np.int16)
    resampled = []
    for d in details:
        values, shown, cell = _on_octaves(d, lowest)
        resampled.append((values, shown, cell))
        row = np.broadcast_to(d.patch[:, None], cell.shape)
        at = row[shown], cell[shown]
        value = values[shown]
        count[at] += 1
        above = value > first[at]
        second[at] = np.where(above, first[at], np.maximum(second[at], value))
        first[at] = np.where(above, value, first[at])
    with np.errstate(invalid="ignore"):
        yardsticks = np.where(count >= 3, 0.5 * (first + second), first)
    missing = []
    for d, (values, shown, cell) in zip(details, resampled, strict=True):
        at = d.patch[:, None], cell
        lack = yardsticks[at] - values
        # Detail drowned in noise lacks at least this much, if the others show more than the noise.
        known = np.where(shown, count[at] >= 2, lack > 0.5) & np.isfinite(lack)
        missing.append(np.where(known, lack, np.nan))
    return missing


def _on_octaves(d: PatchDetail, lowest: int) -> tuple[FloatArray, BoolArray, IndexArray]:
    """Interpolate a photo's levels to whole octaves of wavelength: values (n,LEVELS-1), shown, octave index.

    Value k lies between levels k and k + 1.
    """
    above: FloatArray = np.ceil(d.octave)
    share = (above - d.octave)[:, None]
    values: FloatArray = d.detail[:, :-1] + share * np.diff(d.detail, axis=1)
    cells: IndexArray = (above.astype(np.int64) - lowest)[:, None] + np.arange(LEVELS - 1)
    return values, d.shown[:, :-1] & d.shown[:, 1:], cells


def _fit_photo(detail: PatchDetail, lack: FloatArray, scale: float, lens: FocusModel | None) -> FocusModel:
    """Fit `sigma²` to the missing detail: a Gaussian blur takes `(frequency sigma)²` off the log energy."""
    share = np.ceil(detail.octave) - detail.octave
    frequency = _FREQUENCY[:-1] * 2.0 ** -share[:, None]
    slope = frequency**2
    # Beyond e^-3 the rest is noise and aliasing: such lack says "at least so much".
    known = np.isfinite(lack)
    weight = np.where(known, slope / (1 + np.maximum(lack, 0)), 0)
    total = (weight * slope).sum(axis=1)
    usable = total > 0
    if np.count_nonzero(usable) < 8:
        return lens or FocusModel(np.zeros(3))
    lack = lack - _contrast_offset(frequency[known] ** 2, lack[known])
    sigma2 = np.sum(np.where(known, weight * lack, 0), axis=1)[usable] / total[usable] / scale**2
    x = detail.nearness[usable]
    span = np.percentile(x, [2, 98])
    coefficients = _robust_parabola(x, np.clip(sigma2, -4, _WORST_BLUR**2))
    return FocusModel(coefficients, (float(span[0]), float(span[1])), lens)


def _contrast_offset(slope: FloatArray, lack: FloatArray) -> float:
    """Detail that a photo lacks at all wavelengths alike: a question of its exposure, not of its focus.

    The intercept of `lack = offset + slope sigma²`, robust, and small as exposure makes it.
    """
    design = np.stack([np.ones_like(slope), slope], axis=1)
    weight = np.ones_like(lack)
    offset = 0.0
    for _ in range(8):
        normal = design.T @ (weight[:, None] * design) + 1e-9 * np.eye(2)
        solution = np.linalg.solve(normal, design.T @ (weight * lack))
        offset = float(solution[0])
        residual = lack - design @ solution
        weight = 1 / (1 + (residual / max(float(np.median(np.abs(residual))), 0.05) / 3) ** 2)
    return float(np.clip(offset, -_CONTRAST, _CONTRAST))


def _robust_parabola(x: FloatArray, y: FloatArray) -> FloatArray:
    """Coefficients (3,) of `y = c0 + c1 x + c2 x²` with c2 >= 0, by reweighted least squares.

    Where x hardly varies, or the parabola explains no more than a constant, the median stands.
    """
    median = float(np.median(y))
    constant = np.array([median, 0.0, 0.0])
    low, high = np.percentile(x, [5, 95])
    if len(x) < 40 or high < 1.15 * low:
        return constant
    t = np.clip((x - low) / (high - low), -0.1, 1.1)
    design = np.stack([np.ones_like(t), t, t * t], axis=1)
    c = np.array([median, 0.0, 0.0])
    for _ in range(15):
        residual = y - design @ c
        scale = max(1.4826 * float(np.median(np.abs(residual))), 0.05)
        weight = 1 / (1 + (residual / (2 * scale)) ** 2)
        normal = design.T @ (weight[:, None] * design) + 1e-6 * len(y) * np.eye(3)
        c = np.linalg.solve(normal, design.T @ (weight * y))
        if c[2] < 0:
            c = np.append(np.linalg.solve(normal[:2, :2], design[:, :2].T @ (weight * y)), 0.0)
    spread = np.median(np.abs(y - median))
    if np.median(np.abs(y - design @ c)) > 0.9 * spread:
        return constant
    start, width = low / (high - low), high - low
    return np.array(
        [c[0] - c[1] * start + c[2] * start**2, (c[1] - 2 * c[2] * start) / width, c[2] / width**2]
    )
