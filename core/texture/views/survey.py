"""One pass over all photos: what each sees, in which colour and how sharp, kept small enough for hundreds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TypeVar

import numpy as np

from ...arrays import AnyArray, FloatArray
from ...jobs import Job, Progress
from ...photos.view import View
from ...settings import TextureSettings
from ..surface import Surface
from .agreement import Preview
from .candidates import CandidateTable, candidate_cost
from .focus import FocusModel, PatchDetail, no_detail, patch_detail
from .focus_range import in_depth_of_field, lens_focus
from .images import read_photo, read_reduced_photo, view_name
from .kept import KeptPhotos
from .memory import plan_memory
from .parallel import map_ahead
from .samples import PhotoSamples, sample_photo
from .visibility import SeenFaces, visible_faces

_Part = TypeVar("_Part", SeenFaces, PhotoSamples, PatchDetail)
_PATCHES = 32_000
"""Upper bound of the patches on which sharpness is compared."""


@dataclass(frozen=True, eq=False)
class PhotoSurvey:
    """What one photo contributes: its faces, their samples and detail, and a reduced picture of it.

    `scale` is the one at which the photo was analysed; `lens` (3,) the coefficients of the blur that its
    lens's settings cause, NaN when they are not known.
    """

    seen: SeenFaces
    samples: PhotoSamples
    detail: PatchDetail
    preview: Preview
    scale: float
    lens: FloatArray

    def to_arrays(self) -> dict[str, AnyArray]:
        """Everything as named arrays, to be kept in a file."""
        parts = (self.seen, self.samples, self.detail, self.preview)
        named = {
            f"{type(p).__name__}.{f.name}": np.asarray(getattr(p, f.name)) for p in parts for f in fields(p)
        }
        return named | {"scale": np.array(self.scale), "lens": self.lens}

    @classmethod
    def from_arrays(cls, saved: dict[str, AnyArray]) -> PhotoSurvey:
        """Undo `to_arrays`."""
        preview = Preview(saved["Preview.grey"], float(saved["Preview.scale"]))

        def part(kind: type[_Part]) -> _Part:
            return kind(**{f.name: saved[f"{kind.__name__}.{f.name}"] for f in fields(kind)})

        seen, samples, detail = part(SeenFaces), part(PhotoSamples), part(PatchDetail)
        return cls(seen, samples, detail, preview, float(saved["scale"]), saved["lens"])

    @property
    def lens_focus(self) -> FocusModel | None:
        """What the lens's settings say about the blur."""
        return FocusModel(self.lens) if np.isfinite(self.lens).all() else None


@dataclass(frozen=True, eq=False)
class Survey:
    """What all V photos contribute; `scales` (V,) at which they were analysed, `lenses` their settings.

    Photos that see no face have no preview and no detail.
    """

    table: CandidateTable
    details: list[PatchDetail]
    previews: list[Preview | None]
    scales: FloatArray
    lenses: list[FocusModel | None]


def survey_photos_job(
    surface: Surface,
    views: Sequence[View],
    priorities: Sequence[float],
    settings: TextureSettings,
    kept: KeptPhotos | None = None,
) -> Job[Survey]:
    """Look at every photo once, a few at a time; -> Survey.

    What is `kept` of a photo is taken over; the others are kept as soon as they have been looked at. Raises
    PhotoError for a photo that cannot be read, TextureError when the memory allowed is not enough.
    """
    kept = kept or KeptPhotos()
    plan = plan_memory(surface.face_count, views, settings)
    table = CandidateTable(surface.face_count, plan.candidates)
    details: list[PatchDetail] = [no_detail()] * len(views)
    previews: list[Preview | None] = [None] * len(views)
    scales = np.ones(len(views))
    lenses: list[FocusModel | None] = [None] * len(views)
    used = [number for number in range(len(views)) if priorities[number] > -np.inf]

    def look(number: int) -> PhotoSurvey | None:
        saved = kept.load(number)
        if saved is not None:
            return PhotoSurvey.from_arrays(saved) if saved else None
        found = survey_photo(surface, views[number], settings)
        kept.save(number, found.to_arrays() if found is not None else {})
        return found

    found = map_ahead(look, used, min(plan.photos_together, len(used)))
    for count, number in enumerate(used):
        yield Progress(count / len(used), f"Looking at {view_name(views[number], number)}")
        one = next(found)
        if one is None:
            continue
        cost = candidate_cost(one.seen, one.samples.clipped, priorities[number], settings)
        table.add(number, one.seen, cost, one.samples)
        details[number], previews[number], scales[number] = one.detail, one.preview, one.scale
        lenses[number] = one.lens_focus
    return Survey(table, details, previews, scales, lenses)


def survey_photo(surface: Surface, view: View, settings: TextureSettings) -> PhotoSurvey | None:
    """Look at one photo; None when it sees no face. Raises PhotoError."""
    seen = visible_faces(surface, view, settings)
    if len(seen) == 0:
        return None
    if settings.sharpness == "published":
        seen = seen.subset(in_depth_of_field(read_photo(view), view, seen, settings))
        if len(seen) == 0:
            return None
    lens = lens_focus(view)
    photo, scale = read_reduced_photo(view, settings.analysed_pixels)
    patch_size = max(1, -(-surface.face_count // _PATCHES))
    return PhotoSurvey(
        seen.summary,
        sample_photo(photo, scale, seen, settings),
        patch_detail(photo, scale, seen, patch_size),
        Preview.of_photo(photo, scale),
        scale,
        np.full(3, np.nan) if lens is None else lens.coefficients,
    )
