"""The colour chart of a project: what turns the photos' colours into true ones when they are baked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ...arrays import BoolArray
from ...errors import PhotoError
from ...jobs import Job, Progress
from ...photos.image import read_image
from ...texture.colour.colour_chart import REFERENCE, find_colour_chart
from ...texture.colour.correction import ColourCorrection, Method, fit_correction
from .textures import TexturedScan

if TYPE_CHECKING:  # the cloud's room reads the entries of charts
    from .cloud import ColouredCloud

_SMOOTHING = (0.01, 0.02, 0.04, 0.06)
"""Parts of its length by which an outline is straightened until four corners are left."""


@dataclass(frozen=True)
class ColourChartEntry:
    """The photo that shows the chart, the layer it stands for, and four `corners` of its field in pixels."""

    photo: Path
    layer: str = ""
    corners: tuple[tuple[float, float], ...] | None = None
    method: Method = "matrix"


@dataclass(frozen=True, eq=False)
class ChartResult:
    """The correction of a chart and the name of its photo; the original's pixels are never changed."""

    photo: str
    correction: ColourCorrection

    @property
    def told(self) -> str:
        """Its numbers in words."""
        c = self.correction
        return (
            f"colour difference (CIEDE2000) {c.before:.1f} before, {c.after:.1f} after, worst patch "
            f"{c.worst:.1f}, {c.left_out:.1f} for patches left out of the fit"
        )


def read_chart_job(entry: ColourChartEntry) -> Job[ChartResult]:
    """Find the chart in its photo and fit the correction.

    Raises PhotoError that names the photo where no chart is found.
    """
    yield Progress(0.0, f"Looking for the colour chart in {entry.photo.name}")
    try:
        chart = find_colour_chart(read_image(entry.photo), entry.corners)
        yield Progress(0.5, "Fitting the colours of the chart")
        fitted = fit_correction(chart.colour, REFERENCE, chart.usable, entry.method)
    except PhotoError as error:
        raise PhotoError(f"{entry.photo.name}: {error}") from error
    return ChartResult(entry.photo.stem, fitted)


def found_chart_job(
    entry: ColourChartEntry, mask: BoolArray | None
) -> Job[tuple[ColourChartEntry, ChartResult]]:
    """Find the chart by itself, else within a mark (H,W) of its field of patches.

    Returns the entry that finds it again, too. Raises PhotoError.
    """
    try:
        return entry, (yield from read_chart_job(entry))
    except PhotoError:
        if mask is None:
            raise
    marked = replace(entry, corners=quadrilateral(mask))
    return marked, (yield from read_chart_job(marked))


def quadrilateral(mask: BoolArray) -> tuple[tuple[float, float], ...]:
    """Four corners (u, v) of a mark. Raises PhotoError where it has not the shape of a quadrilateral."""
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    hull = cv2.convexHull(max(outlines, key=cv2.contourArea)) if outlines else np.zeros((0, 1, 2), np.int32)
    for share in _SMOOTHING:
        corners = cv2.approxPolyDP(hull, share * cv2.arcLength(hull, True), True) if len(hull) else hull
        if len(corners) == 4:
            return tuple((float(u), float(v)) for u, v in corners[:, 0])
    raise PhotoError("The colour chart's mark has not four corners: mark its field of patches as a polygon.")


def correction_for(
    chart: ChartResult, entry: ColourChartEntry, textured: TexturedScan | ColouredCloud
) -> ColourCorrection:
    """Return the correction for colours after a texture's gains.

    The gain is that of the chart's photo; a chart photographed apart, in the same light and with the same
    exposure, counts as a photo without gain.
    """
    for number, view in enumerate(textured.views):
        if isinstance(view.image, (str, Path)) and Path(view.image).resolve() == entry.photo.resolve():
            return chart.correction.after_gain(textured.selection.gain[number])
    return chart.correction
