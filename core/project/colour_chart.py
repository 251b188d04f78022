"""The colour chart of a project: what turns the photos' colours into true ones when they are baked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from ..arrays import FloatArray
from ..errors import PhotoError
from ..jobs import Job, Progress
from ..photos.image import read_image
from ..texture.colour_chart import REFERENCE, find_colour_chart
from ..texture.colour_correction import ColourCorrection, Method, fit_correction
from .textures import TexturedScan


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


def read_chart_job(entry: ColourChartEntry, corners: FloatArray | None = None) -> Job[ChartResult]:
    """Find the chart in its photo and fit the correction; `corners` (4,2) pixels before the entry's.

    Raises PhotoError that names the photo where no chart is found.
    """
    yield Progress(0.0, f"Looking for the colour chart in {entry.photo.name}")
    told = entry.corners if corners is None else corners
    try:
        chart = find_colour_chart(read_image(entry.photo), told)
        yield Progress(0.5, "Fitting the colours of the chart")
        fitted = fit_correction(chart.colour, REFERENCE, chart.usable, entry.method)
    except PhotoError as error:
        raise PhotoError(f"{entry.photo.name}: {error}") from error
    return ChartResult(entry.photo.stem, fitted)


def correction_for(chart: ChartResult, entry: ColourChartEntry, textured: TexturedScan) -> ColourCorrection:
    """Return the correction for colours after a texture's gains.

    The gain is that of the chart's photo; a chart photographed apart, in the same light and with the same
    exposure, counts as a photo without gain.
    """
    for number, view in enumerate(textured.views):
        if isinstance(view.image, (str, Path)) and Path(view.image).resolve() == entry.photo.resolve():
            return chart.correction.after_gain(textured.selection.gain[number])
    return replace(chart.correction)
