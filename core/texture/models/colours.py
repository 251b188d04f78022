"""Colours for vertices and for point clouds, where no texture is wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import ArrayLike, BoolArray, ByteArray, FloatArray, IntArray
from ...errors import TextureError
from ...geometry.meshes import face_normals
from ...jobs import Job, Progress, drain, part
from ...photos.view import View
from ...settings import TextureSettings
from ..colour.gains import corrected_colours, photo_gains
from ..colour.levelling import SeamLevels
from ..selection import Selection
from ..surface import checked_mesh
from ..views.candidates import CandidateTable, candidate_cost
from ..views.cloud import Method, point_spacing, visible_points
from ..views.consistency import drop_foreign_job
from ..views.images import (
    check_views,
    full_turn,
    read_photo,
    read_reduced_photo,
    sample_image,
    to_bytes,
    to_linear,
    to_srgb,
    view_name,
)
from ..views.samples import sample_photo
from ..views.splats import Splats, measure_splats_job, tangents
from ..views.visibility import VisibleFaces, project, triangle_areas


@dataclass(frozen=True, eq=False)
class Colours:
    """Colours (N,3) uint8 sRGB of vertices or points, and which of them a photo sees: `seen` (N,)."""

    rgb: ByteArray
    seen: BoolArray


def colour_vertices_job(
    vertices: ArrayLike,
    faces: ArrayLike,
    selection: Selection,
    views: Sequence[View],
    levels: SeamLevels | None = None,
) -> Job[Colours]:
    """Colour the vertices of a textured mesh: the mean of what the faces around show there, by area.

    (V,3) m, (F,3) -> Colours in linear light averaged, gains and `levels` applied. Raises PhotoError.
    """
    points, triangles = checked_mesh(vertices, faces)
    area = face_normals(points, triangles)[1]
    total, weight = np.zeros((len(points), 3)), np.zeros(len(points))
    for number in np.unique(selection.view[selection.view >= 0]).tolist():
        yield Progress(number / len(views), f"Reading {view_name(views[number], number)}")
        photo = read_photo(views[number], number)
        chosen = np.flatnonzero(selection.view == number)
        wraps = full_turn(views[number].camera) > 0
        colours = sample_image(photo, selection.uv[chosen].reshape(-1, 2), wraps)
        linear = to_linear(colours) * selection.gain[number]
        if levels is not None:
            linear = linear * levels.factor[chosen].reshape(-1, 3)
        corner, share = triangles[chosen].ravel(), np.repeat(area[chosen] + 1e-12, 3)
        weight += np.bincount(corner, share, len(points))
        for channel in range(3):
            total[:, channel] += np.bincount(corner, share * linear[:, channel], len(points))
    seen = weight > 0
    mean = total / np.where(seen, weight, 1)[:, None]
    return Colours(to_bytes(to_srgb(mean)), seen)


def colour_vertices(
    vertices: ArrayLike,
    faces: ArrayLike,
    selection: Selection,
    views: Sequence[View],
    levels: SeamLevels | None = None,
) -> Colours:
    """Run `colour_vertices_job` to its end."""
    return drain(colour_vertices_job(vertices, faces, selection, views, levels))


@dataclass(frozen=True, eq=False)
class PointSelection:
    """Photo of every point of a cloud: `view` (N,), -1 where unseen; `pixel` (N,2) in it; `gain` (V,3).

    `colours` are the points' colours after the gains; `texel_size` (N,) m, NaN where unseen.
    """

    view: IntArray
    pixel: FloatArray
    gain: FloatArray
    texel_size: FloatArray
    colours: Colours


def select_views_for_points(
    points: ArrayLike,
    normals: ArrayLike | None,
    views: Sequence[View],
    settings: TextureSettings | None = None,
    method: Method = "depth",
) -> PointSelection:
    """Run `select_views_for_points_job` to its end."""
    return drain(select_views_for_points_job(points, normals, views, settings, method))


def select_views_for_points_job(
    points: ArrayLike,
    normals: ArrayLike | None,
    views: Sequence[View],
    settings: TextureSettings | None = None,
    method: Method = "depth",
) -> Job[PointSelection]:
    """Choose a photo for every point of a cloud: (N,3) m, unit normals (N,3) or None -> PointSelection.

    Visibility by `method`, see `cloud.visible_points`; cost, gains and the rejection of strangers are those
    of meshes. Source: method.md 4, eq. 3.40 for the choice per vertex. Raises TextureError, PhotoError.
    """
    settings = settings or TextureSettings()
    cloud = np.asarray(points, dtype=np.float64)
    if cloud.ndim != 2 or cloud.shape[1] != 3 or len(cloud) == 0 or not np.isfinite(cloud).all():
        raise TextureError("The cloud must be a table of finite x, y, z with at least one point.")
    check_views(views)
    yield Progress(0.0, "Measuring the cloud's density")
    spacing, splats = point_spacing(cloud), None
    if method == "depth" and normals is not None:
        splats = yield from part(measure_splats_job(cloud, normals), 0.0, 0.1)
    table = CandidateTable(len(cloud), min(settings.max_candidates, len(views)))
    for number, view in enumerate(views):
        yield Progress(0.1 + 0.8 * number / len(views), f"Looking at {view_name(view, number)}")
        seen = _seen_points(cloud, normals, view, method, spacing, splats, settings)
        if len(seen):
            photo, scale = read_reduced_photo(view, settings.analysed_pixels)
            samples = sample_photo(photo, scale, seen, settings)
            summary = seen.summary
            table.add(number, summary, candidate_cost(summary, samples.clipped, 0.0, settings), samples)
    yield Progress(0.9, "Comparing the photos' colours")
    gain = np.ones((len(views), 3))
    if settings.equalise:
        gain = photo_gains(table, len(views), settings.gain_anchor)
    colours = corrected_colours(table, gain)
    if settings.reject_foreign and len(views) > 2:
        yield from part(drop_foreign_job(table, [view.camera for view in views], colours), 0.92, 0.98)
    rows, slot = np.arange(len(cloud)), np.argmin(table.cost, axis=1)
    view_of = table.view[rows, slot].astype(np.int32)
    seen_at_all = view_of >= 0
    texel = np.where(seen_at_all, table.texel[rows, slot], np.nan).astype(np.float64)
    pixel = np.zeros((len(cloud), 2))
    for number, view in enumerate(views):
        chosen = view_of == number
        pixel[chosen] = project(view, cloud[chosen])
    return PointSelection(view_of, pixel, gain, texel, Colours(colours[rows, slot], seen_at_all))


def _seen_points(
    cloud: FloatArray,
    normals: ArrayLike | None,
    view: View,
    method: Method,
    spacing: float,
    splats: Splats | None,
    settings: TextureSettings,
) -> VisibleFaces:
    """Points that a photo sees, each as a small triangle on its tangent plane, `spacing` across."""
    visible = visible_points(cloud, normals, view, method, splats=splats)
    towards = view.centre - cloud
    distance = np.linalg.norm(towards, axis=1)
    facing = towards / np.maximum(distance, 1e-12)[:, None]
    normal = facing if normals is None else np.asarray(normals, dtype=np.float64)
    cosine = np.einsum("nk,nk->n", facing, normal)
    chosen = np.flatnonzero(visible & (cosine > np.cos(np.radians(settings.max_angle))))
    corners = _triangles(cloud[chosen], normal[chosen], spacing)
    pixels = project(view, corners.reshape(-1, 3)).reshape(-1, 3, 2)
    inside = view.camera.in_frame(pixels).all(axis=1)
    mask = view.usable
    if mask is not None:
        at = np.rint(np.where(inside[:, None], pixels.mean(axis=1), 0)).astype(np.int64)
        inside &= mask[at[:, 1], at[:, 0]]
    area = triangle_areas(pixels)
    inside &= area > 0
    texel = np.sqrt(_AREA * spacing**2 / np.where(inside, area, 1.0))
    return VisibleFaces(
        chosen[inside],
        pixels[inside],
        np.ones(np.count_nonzero(inside), dtype=np.float32),
        texel[inside].astype(np.float32),
        cosine[chosen[inside]].astype(np.float32),
        distance[chosen[inside]].astype(np.float32),
    )


_AREA = 0.75 * np.sqrt(3.0) * 0.25
"""Area of an equilateral triangle whose circumcircle has the diameter 1."""


def _triangles(points: FloatArray, normals: FloatArray, spacing: float) -> FloatArray:
    """Equilateral triangles around points (n,3) on their tangent planes: -> (n,3,3)."""
    right, up = tangents(normals)
    angle = 2 * np.pi * np.arange(3) / 3
    offset = np.cos(angle)[:, None] * right[:, None] + np.sin(angle)[:, None] * up[:, None]
    corners: FloatArray = points[:, None] + 0.5 * spacing * offset
    return corners
