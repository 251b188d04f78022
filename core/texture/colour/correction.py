"""Colours made true by a colour chart: what a camera's linear RGB must be turned into.

The correction belongs to the photo that shows the chart. For photos made to agree with it by gains, take
`correction.after_gain(selection.gain[chart_photo])`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.optimize import least_squares

from ...arrays import ArrayLike, BoolArray, FloatArray
from ...errors import PhotoError
from .difference import colour_difference, lab_to_linear, linear_to_lab

Method = Literal["matrix", "root-polynomial"]

_FEWEST = 12
"""Patches that must be neither burnt out nor in the dark."""
_OUTLIER = 4.0
"""Difference (L*a*b*) from which a patch counts less: glare or dirt on the chart."""


@dataclass(frozen=True, eq=False)
class ColourCorrection:
    """A map from a photo's linear RGB to true linear sRGB.

    `coefficients` (3,3), or (3,6) on r, g, b and the roots of their products. Differences are CIEDE2000 over
    the patches used: `before`, `after` and `worst` after it; `left_out` is the mean that patches have when
    the correction was found without them: what to expect of other colours.
    """

    method: Method
    coefficients: FloatArray
    before: float
    after: float
    worst: float
    left_out: float

    def apply(self, linear: ArrayLike) -> FloatArray:
        """Correct linear colours (...,3), white 1; results may lie outside [0, 1]."""
        return _terms(np.asarray(linear, dtype=np.float64), self.method) @ self.coefficients.T

    def after_gain(self, gain: ArrayLike) -> ColourCorrection:
        """Return the same correction for colours that the chart's photo has after its gain (3,)."""
        scale = _terms(np.asarray(gain, dtype=np.float64), self.method)
        return replace(self, coefficients=self.coefficients / scale)


def fit_correction(
    measured: ArrayLike, reference: ArrayLike, usable: BoolArray | None = None, method: Method = "matrix"
) -> ColourCorrection:
    """Find the correction of a chart: measured linear RGB (n,3), true L*a*b* D50 (n,3) -> ColourCorrection.

    Both methods keep hues when the light is stronger or weaker. `usable` (n,) leaves patches out. Raises
    PhotoError when too few are left. Source: Finlayson, Mackiewicz and Hurlbert 2015 (root-polynomial, degree
    2); least squares in L*a*b*, where differences are as large as they look.
    """
    linear, lab = np.asarray(measured, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    keep = np.ones(len(lab), dtype=np.bool_) if usable is None else usable
    if np.count_nonzero(keep) < _FEWEST:
        raise PhotoError(
            f"Only {np.count_nonzero(keep)} patches of the colour chart are neither burnt out nor black: "
            "expose the photo so that its white patch is below 250 of 255."
        )
    linear, lab = linear[keep], lab[keep]
    coefficients = _fit(linear, lab, method)
    after = colour_difference(linear_to_lab(_terms(linear, method) @ coefficients.T), lab)
    left_out = []
    for number in range(len(lab)):
        others = np.arange(len(lab)) != number
        without = _fit(linear[others], lab[others], method)
        seen = linear_to_lab(_terms(linear[number], method) @ without.T)
        left_out.append(float(colour_difference(seen, lab[number])))
    before = float(np.mean(colour_difference(linear_to_lab(linear), lab)))
    worst, mean = float(after.max()), float(after.mean())
    return ColourCorrection(method, coefficients, before, mean, worst, float(np.mean(left_out)))


def _fit(linear: FloatArray, lab: FloatArray, method: Method) -> FloatArray:
    """Coefficients by least squares in linear light, then in L*a*b*; misfits count less."""
    terms = _terms(linear, method)
    start = np.linalg.lstsq(terms, lab_to_linear(lab), rcond=None)[0].T

    def residual(flat: FloatArray) -> FloatArray:
        difference: FloatArray = (linear_to_lab(terms @ flat.reshape(start.shape).T) - lab).ravel()
        return difference

    found = least_squares(residual, start.ravel(), loss="soft_l1", f_scale=_OUTLIER, max_nfev=60)
    coefficients: FloatArray = found.x.reshape(start.shape)
    return coefficients


def _terms(linear: FloatArray, method: Method) -> FloatArray:
    """What the coefficients multiply: (...,3) -> (...,3) or (...,6)."""
    if method == "matrix":
        return linear
    r, g, b = np.moveaxis(np.maximum(linear, 0), -1, 0)
    return np.stack([r, g, b, np.sqrt(r * g), np.sqrt(g * b), np.sqrt(r * b)], axis=-1)
