"""What is covered and how well, and where to shoot next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import ArrayLike, BoolArray, FloatArray, IndexArray
from ..cameras.base import Camera
from ..geometry.meshes import face_normals
from ..geometry.rigid import rotation_between
from ..jobs import Job, Progress, drain
from ..photos.view import View
from ..settings import TextureSettings
from .selection import Selection
from .surface import Surface
from .views.visibility import visible_faces

_PROPOSALS = 60
_CLEARANCE = 0.15
"""Share of the distance to what is photographed that a camera keeps from everything else."""
_AROUND = np.array(
    [(x, y, z) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0) for z in (-1.0, 0.0, 1.0) if x or y or z]
)
_LEAST_SHARE = 0.01
"""Share of the weak area below which another photo is not worth the way..."""
_LEAST_FRAME = 0.1
"""... unless it is this share of what a frame shows at the wanted texel size: large scans take many."""
_NEAREST = 0.3
"""Share of the wanted distance below which a place is no longer useful: it would show too little."""


@dataclass(frozen=True)
class Coverage:
    """Areas in m²: `total`, `seen` by a photo, `sharp_enough` of these for the wanted texel size.

    `texel_size` is the median over the seen area (m), `views` the mean number of photos that see it.
    """

    total: float
    seen: float
    sharp_enough: float
    texel_size: float
    views: float

    @property
    def share(self) -> float:
        """Part of the area that has a photo."""
        return self.seen / self.total if self.total > 0 else 0.0


def measure_coverage(
    vertices: ArrayLike, faces: ArrayLike, selection: Selection, wanted_texel: float
) -> Coverage:
    """Measure what the photos cover of a mesh (V,3) m, (F,3); `wanted_texel` in m."""
    area = face_normals(vertices, faces)[1]
    seen = selection.view >= 0
    fine = seen & (selection.texel_size <= wanted_texel)
    total = float(area[seen].sum())
    return Coverage(
        float(area.sum()),
        total,
        float(area[fine].sum()),
        _weighted_median(selection.texel_size[seen].astype(np.float64), area[seen]),
        float(np.sum(area[seen] * selection.view_count[seen]) / total) if total > 0 else 0.0,
    )


@dataclass(frozen=True, eq=False)
class Standpoint:
    """A place for another photo: `centre` (3,) m, `direction` (3,) unit, and the area `gain` m² it adds."""

    centre: FloatArray
    direction: FloatArray
    gain: float


def next_standpoints(
    vertices: ArrayLike,
    faces: ArrayLike,
    selection: Selection,
    camera: Camera,
    wanted_texel: float,
    count: int = 5,
    up: ArrayLike = (0.0, 0.0, 1.0),
) -> list[Standpoint]:
    """Run `next_standpoints_job` to its end."""
    return drain(next_standpoints_job(vertices, faces, selection, camera, wanted_texel, count, up))


def next_standpoints_job(
    vertices: ArrayLike,
    faces: ArrayLike,
    selection: Selection,
    camera: Camera,
    wanted_texel: float,
    count: int = 5,
    up: ArrayLike = (0.0, 0.0, 1.0),
) -> Job[list[Standpoint]]:
    """Find places from which `camera` would add most to a textured mesh (V,3) m, (F,3), best first.

    What counts is area that is unseen or coarser than `wanted_texel` (m) and would be fine enough from there.
    Candidates stand in front of such areas, where the scan leaves room; each next one is judged by what the
    ones before it leave.
    """
    yield Progress(0.0, "Sorting the scan")
    surface = Surface.from_mesh(vertices, faces)
    weak = ~(selection.texel_size[surface.order] <= wanted_texel)  # NaN, unseen, is weak too
    views = _candidate_views(surface, weak, camera, wanted_texel, np.asarray(up, dtype=np.float64))
    adds: list[IndexArray] = []
    for number, view in enumerate(views):
        yield Progress(0.1 + 0.9 * number / len(views), "Trying places for the next photo")
        seen = visible_faces(surface, view, TextureSettings(max_angle=75.0))
        adds.append(seen.face[weak[seen.face] & (seen.texel <= wanted_texel)])
    frame = camera.width * camera.height * wanted_texel**2
    least = min(_LEAST_SHARE * float(surface.area[weak].sum()), _LEAST_FRAME * frame)
    return _greedy(surface, views, adds, weak, count, least)


def _greedy(
    surface: Surface,
    views: Sequence[View],
    adds: Sequence[IndexArray],
    weak: BoolArray,
    count: int,
    least: float,
) -> list[Standpoint]:
    """Pick places one after the other, each by the weak area that the ones before leave: `least` m²."""
    left = weak.copy()
    chosen: list[Standpoint] = []
    while len(chosen) < count and views:
        gains = [float(surface.area[faces[left[faces]]].sum()) for faces in adds]
        best = int(np.argmax(gains))
        if gains[best] <= least:
            break
        left[adds[best]] = False
        chosen.append(Standpoint(views[best].centre, np.asarray(views[best].rotation)[2], gains[best]))
    return chosen


def _candidate_views(
    surface: Surface, weak: BoolArray, camera: Camera, wanted_texel: float, up: FloatArray
) -> list[View]:
    """Views that look straight at weak areas from where they would be fine enough, or from nearer."""
    faces = np.flatnonzero(weak & (surface.area > 0))
    if len(faces) == 0:
        return []
    # Faces are in Morton order: steps of equal area along it spread the proposals over the weak surface.
    along = np.cumsum(surface.area[faces])
    targets = faces[np.searchsorted(along, (np.arange(_PROPOSALS) + 0.5) / _PROPOSALS * along[-1])]
    middle = np.array([[(camera.width - 1) / 2, (camera.height - 1) / 2]])
    jacobian = camera.project_with_jacobian(camera.unproject(middle))[1][0]
    density = float(np.linalg.svd(jacobian, compute_uv=False)[0])
    wanted = 0.7 * wanted_texel * density  # nearer than the limit: the frame's edges are farther away
    views = []
    for face in np.unique(targets):
        normal = surface.normal[face].astype(np.float64)
        start = surface.centroid[face] + 1e-4 * wanted * normal
        room = float(surface.caster.first_hit(start, normal[None]).distance[0])
        distance = min(wanted, 0.8 * room)
        centre = surface.centroid[face] + distance * normal
        if distance >= _NEAREST * wanted and _is_free(surface, centre, _CLEARANCE * distance):
            views.append(_facing(camera, centre + surface.origin, -normal, up))
    return views


def _is_free(surface: Surface, centre: FloatArray, clearance: float) -> bool:
    """Whether a camera can stand at `centre` (3,): nothing nearer than `clearance` (m), not inside a solid.

    Looking around from inside a wall or a pillar shows the backs of faces.
    """
    hits = surface.caster.first_hit(centre, _AROUND)
    struck = np.flatnonzero(hits.face >= 0)
    if len(struck) == 0:
        return True
    backs = np.einsum("nk,nk->n", surface.normal[hits.face[struck]], _AROUND[struck]) > 0
    near = bool(hits.distance[struck].min() < clearance)
    return not near and 2 * int(np.count_nonzero(backs)) <= len(struck)


def _facing(camera: Camera, centre: FloatArray, direction: FloatArray, up: FloatArray) -> View:
    """Return a view from `centre` along `direction`, upright as far as the direction allows."""
    down = -up + (up @ direction) * direction
    length = float(np.linalg.norm(down))
    if length < 1e-3:
        rotation = rotation_between(direction, (0.0, 0.0, 1.0))
    else:
        y = down / length
        rotation = np.stack([np.cross(y, direction), y, direction])
    blank = np.zeros((1, 1, 3), dtype=np.uint8)
    return View(camera, rotation, -rotation @ centre, blank)


def _weighted_median(values: FloatArray, weights: FloatArray) -> float:
    if len(values) == 0:
        return float("nan")
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])
