"""The best photo for every face: visibility, quality, choice, UVs. Source: method.md 4 (Alg. 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import ArrayLike, ByteArray, Float32Array, FloatArray, IndexArray, IntArray
from ..errors import TextureError
from ..jobs import Job, Progress, drain, part
from ..photos.view import View
from ..settings import TextureSettings
from .colour.gains import corrected_colours, photo_gains
from .selection import Selection
from .surface import Mesh, Surface, surface_job
from .views.agreement import PoseAgreement, compare_poses_job
from .views.candidates import CandidateTable
from .views.consistency import drop_foreign_job
from .views.focus import FocusModel, fit_focus
from .views.images import check_views, view_name
from .views.kept import KeptPhotos
from .views.labels import label_faces_job
from .views.parallel import CORES, map_ahead
from .views.survey import Survey, survey_photos_job
from .views.visibility import face_pixels, triangle_areas


def select_views(
    vertices: ArrayLike,
    faces: ArrayLike,
    views: Sequence[View],
    settings: TextureSettings | None = None,
    occluders: Sequence[Mesh] = (),
    priorities: Sequence[float] | None = None,
) -> Selection:
    """Run `select_views_job` to its end."""
    return drain(select_views_job(vertices, faces, views, settings, occluders, priorities))


def select_views_job(
    vertices: ArrayLike,
    faces: ArrayLike,
    views: Sequence[View],
    settings: TextureSettings | None = None,
    occluders: Sequence[Mesh] = (),
    priorities: Sequence[float] | None = None,
    kept: KeptPhotos | None = None,
) -> Job[Selection]:
    """Choose a photo for every face of a mesh: (V,3) m, (F,3) -> Selection.

    `occluders` are meshes (vertices, faces) that hide the scan but get no texture. `priorities` prefer photos
    by octaves of texel size (1: as if it were twice as fine); -inf leaves a photo out. Each photo is read
    once, or not at all where what it contributes was `kept` by an interrupted run. Raises TextureError for a
    mesh or poses that cannot be used, PhotoError for a photo that is missing, damaged or of another size than
    its camera. Source: method.md 4, Alg. 4.
    """
    settings = settings or TextureSettings()
    check_views(views)
    preference = _checked_priorities(priorities, len(views))
    surface = yield from part(surface_job(vertices, faces, occluders), 0.0, 0.02)
    survey = yield from part(survey_photos_job(surface, views, preference, settings, kept), 0.02, 0.6)
    findings = yield from part(_judge_job(surface, views, survey, settings), 0.6, 0.75)
    labels = label_faces_job(surface, survey.table, findings.colours, settings.smoothness)
    view = yield from part(labels, 0.75, 0.95)
    return (yield from part(_finish_job(surface, survey.table, views, view, findings), 0.95, 1.0))


def _checked_priorities(priorities: Sequence[float] | None, count: int) -> list[float]:
    if priorities is None:
        return [0.0] * count
    if len(priorities) != count or any(p != p or p == np.inf for p in priorities):
        raise TextureError(f"There must be one priority for each of the {count} photos, a number or -inf.")
    if all(p == -np.inf for p in priorities):
        raise TextureError("All photos are left out: include at least one.")
    return [float(p) for p in priorities]


@dataclass(frozen=True, eq=False)
class _Findings:
    """What comparing the photos gave: gains (V,3), the candidates' colours (F,K,3), verdicts per photo."""

    gain: FloatArray
    colours: ByteArray
    poses: list[PoseAgreement | None]
    focus: list[FocusModel | None]
    foreign: FloatArray


def _judge_job(
    surface: Surface, views: Sequence[View], survey: Survey, settings: TextureSettings
) -> Job[_Findings]:
    """Compare the photos with one another; candidates that do not hold leave the table or cost more."""
    table = survey.table
    poses: list[PoseAgreement | None] = [None] * len(views)
    if settings.check_poses and len(views) > 2:
        poses[:] = yield from part(compare_poses_job(surface, views, survey.previews, table), 0.0, 0.6)
        for number, pose in enumerate(poses):
            if pose is not None and pose.wrong:
                table.drop(*table.of_view(number))
    yield Progress(0.6, "Comparing the photos' colours")
    gain = np.ones((len(views), 3))
    if settings.equalise:
        gain = photo_gains(table, len(views), settings.gain_anchor)
    focus: list[FocusModel | None] = [None] * len(views)
    if settings.sharpness == "compared":
        yield Progress(0.7, "Comparing the photos' sharpness")
        focus[:] = fit_focus(survey.details, survey.scales, survey.lenses)
        _charge_blur(surface, table, views, focus)
    yield Progress(0.8, "Comparing the photos' contents")
    colours = corrected_colours(table, gain)
    foreign = np.zeros(len(views))
    if settings.reject_foreign and len(views) > 2:
        cameras = [view.camera for view in views]
        foreign = yield from part(drop_foreign_job(table, cameras, colours), 0.8, 1.0)
    return _Findings(gain, colours, poses, focus, foreign)


def _charge_blur(
    surface: Surface, table: CandidateTable, views: Sequence[View], focus: Sequence[FocusModel | None]
) -> None:
    """Add to each candidate's cost the octaves of resolution that the photo's blur takes at its distance."""

    def charge(number: int) -> None:
        model = focus[number]
        if model is None:
            return
        face, slot = table.of_view(number)
        distance = _distance(surface, views[number], face)
        table.cost[face, slot] += model.lost_octaves(distance).astype(np.float32)

    for _ in map_ahead(charge, range(len(focus)), CORES):
        pass


def _distance(surface: Surface, view: View, face: IndexArray) -> Float32Array:
    towards = surface.centroid[face] - (view.centre - surface.origin).astype(np.float32)
    distance: Float32Array = np.sqrt(np.einsum("nk,nk->n", towards, towards))
    return distance


def _finish_job(
    surface: Surface, table: CandidateTable, views: Sequence[View], view: IntArray, findings: _Findings
) -> Job[Selection]:
    """Pixels of every face in its photo, and everything back in the caller's order."""
    count = surface.face_count
    uv = np.zeros((count, 3, 2))
    texel, angle, blur = (np.full(count, np.nan, dtype=np.float32) for _ in range(3))
    runner_up = _runner_up(table, view)
    by_view = np.argsort(view, kind="stable")
    bounds = np.searchsorted(view[by_view], np.arange(len(views) + 1))
    for number, one in enumerate(views):
        chosen = by_view[bounds[number] : bounds[number + 1]]
        if len(chosen) == 0:
            continue
        yield Progress(number / len(views), "Laying the faces into the photos")
        caller = surface.order[chosen]
        corners = surface.vertices[surface.faces[chosen]]
        uv[caller] = face_pixels(one, corners + surface.origin)
        texel[caller] = np.sqrt(surface.area[chosen] / triangle_areas(uv[caller]))
        distance = _distance(surface, one, chosen)
        towards = (one.centre - surface.origin).astype(np.float32) - surface.centroid[chosen]
        cosine = np.abs(np.einsum("nk,nk->n", towards, surface.normal[chosen])) / distance
        angle[caller] = np.degrees(np.arccos(np.clip(cosine, 0, 1)))
        focus = findings.focus[number]
        blur[caller] = focus.blur(distance) if focus is not None else np.nan
    back = np.empty(count, dtype=np.int64)
    back[surface.order] = np.arange(count)
    return Selection(
        view[back],
        uv,
        findings.gain,
        runner_up[back],
        table.seen_by[back].astype(np.int32),
        texel,
        angle,
        blur,
        np.array([view_name(one, number) for number, one in enumerate(views)]),
        np.array([pose is not None and pose.wrong for pose in findings.poses]),
        np.array([pose.shift if pose is not None else np.nan for pose in findings.poses]),
        np.array([pose.matched if pose is not None else np.nan for pose in findings.poses]),
        findings.foreign,
    )


def _runner_up(table: CandidateTable, view: IntArray) -> IntArray:
    """Return the cheapest other photo of every face, -1 where there is none."""
    cost = np.where(table.view == view[:, None], np.inf, table.cost)
    slot = np.argmin(cost, axis=1)
    rows = np.arange(len(view))
    return np.where(np.isfinite(cost[rows, slot]), table.view[rows, slot], -1).astype(np.int32)
