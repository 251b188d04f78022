"""One pass over all photos: what each sees, in which colour and how sharp, kept small enough for hundreds."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray
from ..jobs import Job, Progress
from ..photos.view import View
from ..settings import TextureSettings
from .agreement import Preview
from .candidates import CandidateTable, candidate_cost
from .focus import PatchDetail, no_detail, patch_detail
from .images import read_reduced_photo, view_name
from .samples import PhotoSamples, sample_photo
from .surface import Surface
from .visibility import VisibleFaces, visible_faces

_PATCHES = 32_000
"""Upper bound of the patches on which sharpness is compared."""


@dataclass(frozen=True, eq=False)
class PhotoSurvey:
    """What one photo contributes: its faces, their samples and detail, and a reduced picture of it."""

    seen: VisibleFaces
    samples: PhotoSamples
    detail: PatchDetail
    preview: Preview
    scale: float


@dataclass(frozen=True, eq=False)
class Survey:
    """What all V photos contribute; `scales` (V,) at which they were analysed.

    Photos that see no face have no preview and no detail.
    """

    table: CandidateTable
    details: list[PatchDetail]
    previews: list[Preview | None]
    scales: FloatArray


def survey_photos_job(
    surface: Surface, views: Sequence[View], priorities: Sequence[float], settings: TextureSettings
) -> Job[Survey]:
    """Look at every photo once, a few at a time; -> Survey. Raises PhotoError."""
    table = CandidateTable(surface.face_count, min(settings.max_candidates, len(views)))
    nothing = no_detail()
    details: list[PatchDetail] = [nothing] * len(views)
    previews: list[Preview | None] = [None] * len(views)
    scales = np.ones(len(views))
    used = [number for number in range(len(views)) if priorities[number] > -np.inf]
    workers = settings.threads or min(os.cpu_count() or 1, 8)
    for start in range(0, len(used), workers):
        batch = used[start : start + workers]
        yield Progress(start / len(used), f"Looking at {view_name(views[batch[0]], batch[0])}")
        for number, one in zip(batch, _survey_batch(surface, views, batch, settings), strict=True):
            if one is None:
                continue
            cost = candidate_cost(one.seen, one.samples.clipped, priorities[number], settings)
            table.add(number, one.seen, cost, one.samples)
            details[number], previews[number], scales[number] = one.detail, one.preview, one.scale
    return Survey(table, details, previews, scales)


def _survey_batch(
    surface: Surface, views: Sequence[View], batch: Sequence[int], settings: TextureSettings
) -> list[PhotoSurvey | None]:
    """Survey a few photos in parallel; decoding and OpenCV run beside numpy."""
    if len(batch) == 1:
        return [_survey_photo(surface, views[batch[0]], settings)]
    with ThreadPoolExecutor(len(batch)) as pool:
        return list(pool.map(lambda number: _survey_photo(surface, views[number], settings), batch))


def _survey_photo(surface: Surface, view: View, settings: TextureSettings) -> PhotoSurvey | None:
    seen = visible_faces(surface, view, settings)
    if len(seen) == 0:
        return None
    photo, scale = read_reduced_photo(view, settings.analysed_pixels)
    patch_size = max(1, -(-surface.face_count // _PATCHES))
    return PhotoSurvey(
        seen,
        sample_photo(photo, scale, seen, settings),
        patch_detail(photo, scale, seen, patch_size),
        Preview.of_photo(photo, scale),
        scale,
    )
