"""The best photo for every face: visibility, quality, choice, UVs. Source: method.md 4 (Alg. 4)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import ArrayLike, FloatArray, IntArray
from ..jobs import Job, Progress, drain, part
from ..photos.view import View
from ..settings import TextureSettings
from .candidates import CandidateTable, candidate_cost
from .gains import photo_gains
from .images import check_views, read_photo, view_name
from .samples import sample_photo
from .selection import Selection
from .surface import Mesh, Surface
from .visibility import project, triangle_areas, visible_faces


def select_views(
    vertices: ArrayLike,
    faces: ArrayLike,
    views: Sequence[View],
    settings: TextureSettings | None = None,
    occluders: Sequence[Mesh] = (),
) -> Selection:
    """Run `select_views_job` to its end."""
    return drain(select_views_job(vertices, faces, views, settings, occluders))


def select_views_job(
    vertices: ArrayLike,
    faces: ArrayLike,
    views: Sequence[View],
    settings: TextureSettings | None = None,
    occluders: Sequence[Mesh] = (),
) -> Job[Selection]:
    """Choose a photo for every face of a mesh: (V,3) m, (F,3) -> Selection.

    `occluders` are meshes (vertices, faces) that hide the scan but get no texture. Photos are read one after
    the other. Raises TextureError for a mesh or poses that cannot be used, PhotoError for a photo that is
    missing, damaged or of another size than its camera. Source: method.md 4, Alg. 4.
    """
    settings = settings or TextureSettings()
    check_views(views)
    yield Progress(0.0, "Sorting the scan")
    surface = Surface.from_mesh(vertices, faces, occluders)
    table = yield from part(collect_candidates_job(surface, views, settings), 0.02, 0.8)
    gain = np.ones((len(views), 3))
    if settings.equalise:
        yield Progress(0.8, "Comparing the photos' colours")
        gain = photo_gains(table, len(views), settings.gain_anchor)
    best = np.argmin(table.cost, axis=1)
    view = np.take_along_axis(table.view, best[:, None], axis=1)[:, 0].astype(np.int32)
    runner_up = _runner_up(table, view)
    return (yield from part(_finish_job(surface, table, views, view, runner_up, gain), 0.9, 1.0))


def collect_candidates_job(
    surface: Surface, views: Sequence[View], settings: TextureSettings
) -> Job[CandidateTable]:
    """Look at every photo once: which faces it sees, how well, and in which colour."""
    table = CandidateTable(surface.face_count, min(settings.max_candidates, len(views)))
    for number, view in enumerate(views):
        yield Progress(number / len(views), f"Finding what {view_name(view, number)} sees")
        seen = visible_faces(surface, view, settings)
        if len(seen) == 0:
            continue
        yield Progress((number + 0.4) / len(views), f"Reading {view_name(view, number)}")
        samples = sample_photo(read_photo(view, number), seen, settings)
        table.add(number, seen, candidate_cost(seen, samples.clipped, 0.0, settings), samples)
    return table


def _runner_up(table: CandidateTable, view: IntArray) -> IntArray:
    """Return the cheapest other photo of every face, -1 where there is none."""
    cost = np.where(table.view == view[:, None], np.inf, table.cost)
    slot = np.argmin(cost, axis=1)
    rows = np.arange(len(view))
    return np.where(np.isfinite(cost[rows, slot]), table.view[rows, slot], -1).astype(np.int32)


def _finish_job(
    surface: Surface,
    table: CandidateTable,
    views: Sequence[View],
    view: IntArray,
    runner_up: IntArray,
    gain: FloatArray,
) -> Job[Selection]:
    """Pixels of every face in its photo, and everything back in the caller's order."""
    count = surface.face_count
    uv = np.zeros((count, 3, 2))
    texel = np.full(count, np.nan, dtype=np.float32)
    angle = np.full(count, np.nan, dtype=np.float32)
    faces_of = np.argsort(view, kind="stable")
    bounds = np.searchsorted(view[faces_of], np.arange(len(views) + 1))
    for number, one in enumerate(views):
        chosen = faces_of[bounds[number] : bounds[number + 1]]
        if len(chosen) == 0:
            continue
        yield Progress(number / len(views), "Laying the faces into the photos")
        corners = project(one, surface.vertices[surface.faces[chosen]].reshape(-1, 3) + surface.origin)
        pixels = corners.reshape(-1, 3, 2)
        towards = one.centre - surface.origin - surface.centroid[chosen]
        cosine = np.einsum("nk,nk->n", towards, surface.normal[chosen]) / np.linalg.norm(towards, axis=1)
        caller = surface.order[chosen]
        uv[caller] = pixels
        texel[caller] = np.sqrt(surface.area[chosen] / triangle_areas(pixels))
        angle[caller] = np.degrees(np.arccos(np.clip(np.abs(cosine), 0, 1)))
    back = np.empty(count, dtype=np.int64)
    back[surface.order] = np.arange(count)
    return Selection(
        view[back], uv, gain, runner_up[back], table.seen_by[back].astype(np.int32), texel, angle
    )
