"""Splitting faces too large for straight UV edges.

A renderer interpolates UVs linearly within a face, while perspective and lens distortion are not linear.
Where the difference would be visible, or where no photo shows a large face whole, its edges are halved; both
neighbours of an edge are split alike, so that no gaps open.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...arrays import ArrayLike, BoolArray, FloatArray, IndexArray, IntArray
from ...geometry.meshes import morton_order
from ...geometry.rays import RayCaster, local_centre
from ...jobs import Job, Progress, drain, part
from ...photos.view import View
from ..surface import checked_mesh, used_vertices
from ..views.images import check_views, view_name
from ..views.parallel import CORES, map_ahead
from ..views.visibility import project
from .widefaces import LensCurvature, WideFaces

_ROUNDS = 14
_STEPS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
_NEARLY = 0.8
"""Share of the tolerance that the middle of an edge may be off without a closer look."""
_SHORT = 0.1
"""Length of an edge over its distance up to which its middle stands for all of it."""
_GRAZING = 1e-9
"""Sine of the angle by which a ray may pass by a face's edge and still count as meeting it."""
_AT_ONCE = 256
"""Faces that all rays of a frame are held against at once."""
_FRAME_SHARE = 1 / 64
"""Edges longer than this share of the frame's diagonal are cut where a face leaves the frame."""


@dataclass(frozen=True, eq=False)
class SplitMesh:
    """A refined mesh: vertices (V',3) m, faces (F',3), and `parent` (F',), each face's number before.

    The first V vertices are the original ones; `ends` (V' - V,2) are the vertices each new one halves.
    """

    vertices: FloatArray
    faces: IntArray
    parent: IntArray
    ends: IntArray


def split_large_faces(
    vertices: ArrayLike,
    faces: ArrayLike,
    views: Sequence[View],
    tolerance: float = 0.5,
    double_sided: bool = False,
) -> SplitMesh:
    """Run `split_large_faces_job` to its end."""
    return drain(split_large_faces_job(vertices, faces, views, tolerance, double_sided))


def split_large_faces_job(
    vertices: ArrayLike,
    faces: ArrayLike,
    views: Sequence[View],
    tolerance: float = 0.5,
    double_sided: bool = False,
) -> Job[SplitMesh]:
    """Halve edges until straight UV edges are within `tolerance` pixels in every photo that sees the face.

    (V,3) m, (F,3) -> SplitMesh. With `double_sided` faces seen from behind count too. Raises TextureError,
    PhotoError for input that cannot be used.
    """
    points, triangles = checked_mesh(vertices, faces)
    check_views(views)
    origin = local_centre(points)
    points = points - origin
    parent = np.arange(len(triangles), dtype=np.int32)
    hits = _Hits(points, triangles)
    yield Progress(0.0, "Sorting the scan by size of its faces")
    doubtful = morton_order(points[triangles[:, 0]])
    ends = [np.zeros((0, 2), dtype=np.int32)]
    cameras = {id(view.camera): view.camera for view in views}  # most photos share theirs
    curvature = {key: LensCurvature.of_camera(camera) for key, camera in cameras.items()}
    lenses = [curvature[id(view.camera)] for view in views]
    for depth in range(_ROUNDS):
        wide = WideFaces(points, triangles, doubtful, double_sided)
        look = partial(_edges_to_cut, wide, origin=origin, hits=hits, parent=parent, tolerance=tolerance)
        round_ = _flagged_job(views, lenses, len(triangles), look)
        flagged = yield from part(round_, depth / _ROUNDS, (depth + 1) / _ROUNDS)
        if not flagged.any():
            break
        points, triangles, origin_face, halves = _halve(points, triangles, flagged)
        parent = parent[origin_face]
        doubtful = np.flatnonzero(_any_edge(flagged)[origin_face])
        ends.append(halves)
    return SplitMesh(points + origin, triangles, parent, np.concatenate(ends))


_Look = Callable[[View, LensCurvature], tuple[IndexArray, BoolArray]]


def _flagged_job(
    views: Sequence[View], lenses: Sequence[LensCurvature], face_count: int, look: _Look
) -> Job[BoolArray]:
    """Edges (F,3) that any of the views wants halved."""
    flagged = np.zeros((face_count, 3), dtype=np.bool_)
    found = map_ahead(lambda number: look(views[number], lenses[number]), range(len(views)), CORES)
    for number, view in enumerate(views):
        yield Progress(number / len(views), f"Checking large faces in {view_name(view, number)}")
        seen, cut = next(found)
        flagged[seen] |= cut
    return flagged


def _any_edge(flagged: BoolArray) -> BoolArray:
    """Faces with an edge that is flagged: (F,3) -> (F,)."""
    # Column by column: reducing along an axis of three is many times slower.
    faces: BoolArray = flagged[:, 0] | flagged[:, 1] | flagged[:, 2]
    return faces


class _Hits:
    """Which faces of a mesh rays from an eye meet first; the ray caster is made when it is first needed."""

    def __init__(self, points: FloatArray, faces: IntArray) -> None:
        self._mesh = points, faces
        self._lock = threading.Lock()
        self._caster: RayCaster | None = None

    def faces(self, eye: FloatArray, rays: FloatArray) -> IntArray:
        """First face along each ray (P,3), -1 for none."""
        with self._lock:
            if self._caster is None:
                self._caster = RayCaster(*self._mesh)
        return self._caster.first_hit(eye, rays).face


def _edges_to_cut(
    wide: WideFaces,
    view: View,
    lens: LensCurvature,
    *,
    origin: FloatArray,
    hits: _Hits,
    parent: IntArray,
    tolerance: float,
) -> tuple[IndexArray, BoolArray]:
    """Faces (n,) that a view looks at closely, and which of their edges (n,3) it wants halved.

    Edge k runs from corner k to corner k + 1.
    """
    chosen = wide.seen_bent(view, lens, origin, tolerance)
    longest = _FRAME_SHARE * float(np.hypot(view.camera.width, view.camera.height))
    clear = tolerance, longest / lens.density
    chosen = chosen[_in_doubt(wide.points, wide.faces[chosen], view, origin, *clear)]
    if len(chosen) == 0:
        return chosen, np.zeros((0, 3), dtype=np.bool_)
    corners = wide.points[wide.faces[chosen]]
    pixels, angle = _along_edges(corners, view, origin)
    inside = view.camera.in_frame(pixels)
    error = _interpolation_error(view.camera.unwrapped(pixels, pixels[:, :1, :1]))
    bent = (error > tolerance) & inside.any(axis=2)
    large = angle * lens.density > longest
    partly = ~inside.all(axis=(1, 2)) & large.any(axis=1)
    around = partly & ~inside.any(axis=(1, 2))  # perhaps the frame lies within the face
    rays = lens.probes @ np.asarray(view.rotation)
    around[around] = _meet(corners[around] - (view.centre - origin), rays)
    partly &= around | inside.any(axis=(1, 2))
    if around.any():  # the frame lies within the face, unless something hides it
        partly &= ~around | np.isin(parent[chosen], hits.faces(view.centre - origin, rays))
    return chosen, bent | (partly[:, None] & large)


def _meet(corners: FloatArray, rays: FloatArray) -> BoolArray:
    """Whether triangles (n,3,3), their corners relative to the eye, are met by any of the rays (P,3): (n,).

    A ray passes through a triangle when it lies on its side of the three planes through the eye and an edge;
    one that passes by the edge within rounding counts.
    """
    planes = np.cross(corners, np.roll(corners, -1, axis=1))
    planes /= np.maximum(np.linalg.norm(planes, axis=2, keepdims=True), 1e-300)
    planes *= np.sign(np.einsum("nk,nk->n", corners[:, 2], planes[:, 0]))[:, None, None]
    met = np.zeros(len(corners), dtype=np.bool_)
    for start in range(0, len(corners), _AT_ONCE):
        sides = planes[start : start + _AT_ONCE] @ rays.T
        within = (sides[:, 0] > -_GRAZING) & (sides[:, 1] > -_GRAZING) & (sides[:, 2] > -_GRAZING)
        met[start : start + _AT_ONCE] = within.any(axis=1)
    return met


def _in_doubt(
    points: FloatArray, faces: IntArray, view: View, origin: FloatArray, tolerance: float, small: float
) -> BoolArray:
    """Faces (n,3) that the middles of their edges do not clear: (n,).

    An edge that is short against its distance is off most in its middle. What is nearly straight there and
    lies in the frame, or is seen at less than `small` rad, is fine; so is what lies outside the frame.
    """
    if len(faces) == 0:
        return np.zeros(0, dtype=np.bool_)
    vertex, local = used_vertices(faces, len(points))
    corner = (points[vertex] - (view.centre - origin))[local]
    after = np.roll(corner, -1, axis=1)
    middle = project(view, (0.5 * (corner + after) + view.centre).reshape(-1, 3)).reshape(-1, 3, 2)
    at = project(view, points[vertex] + origin)[local]
    at = view.camera.unwrapped(at, at[:, :1])
    middle = view.camera.unwrapped(middle, at[:, :1])
    with np.errstate(invalid="ignore"):
        squared = _largest_square(middle - 0.5 * (at + np.roll(at, -1, axis=1)))
        edge = np.sqrt(_largest_square(after - corner))
        nearest = np.sqrt(np.einsum("nc,nc->n", corner[:, 0], corner[:, 0])) - edge
        short = edge < _SHORT * nearest
        straight = squared < (_NEARLY * tolerance) ** 2
        apart = _apart_from_frame(at, middle, 1.0 + 2.0 * np.sqrt(squared), view)
    framed = view.camera.in_frame(at)
    fits = framed[:, 0] & framed[:, 1] & framed[:, 2] | (edge < small * nearest)
    doubt: BoolArray = ~(short & ((fits & straight) | apart))
    return doubt


def _largest_square(vectors: FloatArray) -> FloatArray:
    """Square of the longest of three vectors: (n,3,c) -> (n,), NaN where one is."""
    square = np.einsum("nkc,nkc->kn", vectors, vectors)
    largest: FloatArray = np.maximum(np.maximum(square[0], square[1]), square[2])
    return largest


def _apart_from_frame(at: FloatArray, middle: FloatArray, margin: FloatArray, view: View) -> BoolArray:
    """Whether the box around six pixels (n,3,2), (n,3,2), grown by `margin` (n,), misses the frame."""
    low, high = np.minimum(at[:, 0], middle[:, 0]), np.maximum(at[:, 0], middle[:, 0])
    for k in (1, 2):
        low = np.minimum(np.minimum(low, at[:, k]), middle[:, k])
        high = np.maximum(np.maximum(high, at[:, k]), middle[:, k])
    width, height = view.camera.width, view.camera.height
    apart: BoolArray = (high[:, 0] < -0.5 - margin) | (low[:, 0] > width - 0.5 + margin)
    return apart | (high[:, 1] < -0.5 - margin) | (low[:, 1] > height - 0.5 + margin)


def _along_edges(corners: FloatArray, view: View, origin: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels of 5 points along each edge and each edge's angle seen: (n,3,3) -> (n,3,5,2), (n,3) rad."""
    after = np.roll(corners, -1, axis=1)
    along = corners[:, :, None] + _STEPS[:, None] * (after - corners)[:, :, None]
    pixels = project(view, along.reshape(-1, 3) + origin).reshape(*along.shape[:3], 2)
    rays = along - (view.centre - origin)
    rays /= np.maximum(np.linalg.norm(rays, axis=3, keepdims=True), 1e-12)
    step = np.linalg.norm(np.diff(rays, axis=2), axis=3)
    return pixels, step.sum(axis=2)


def _interpolation_error(pixels: FloatArray) -> FloatArray:
    """Largest distance between true and interpolated pixels along edges: (n,3,5,2) -> (n,3)."""
    straight = pixels[:, :, :1] + _STEPS[:, None] * (pixels[:, :, -1:] - pixels[:, :, :1])
    error = np.linalg.norm(pixels - straight, axis=3)
    largest: FloatArray = np.nan_to_num(error, nan=0.0).max(axis=2)
    return largest


def _halve(
    points: FloatArray, faces: IntArray, flagged: BoolArray
) -> tuple[FloatArray, IntArray, IndexArray, IntArray]:
    """Halve the flagged edges in every face that has them -> points, faces, each face's origin, new ends.

    A face with one such edge becomes two, with two three, with three four triangles.
    """
    touched = _beside(faces, flagged, len(points))
    corners = faces[touched]
    ends, at = _cut_edges(corners, flagged[touched], len(points))
    middle = 0.5 * (points[ends[:, 0]] + points[ends[:, 1]])
    pieces, owner = _cut_faces(corners, at, len(points))
    count = np.ones(len(faces), dtype=np.int64)
    count[touched] = np.maximum(np.bincount(owner, minlength=len(touched)), 1)
    parent = np.repeat(np.arange(len(faces)), count)
    triangles = faces[parent]
    triangles[(count > 1)[parent]] = pieces[np.argsort(owner, kind="stable")]
    return np.concatenate([points, middle]), triangles, parent, ends


def _beside(faces: IntArray, flagged: BoolArray, vertex_count: int) -> IndexArray:
    """Faces that may share a flagged edge: two of their corners belong to one."""
    marked = np.zeros(vertex_count, dtype=np.bool_)
    face, edge = np.nonzero(flagged)
    marked[faces[face, edge]] = marked[faces[face, (edge + 1) % 3]] = True
    a, b, c = (marked[faces[:, k]] for k in range(3))
    return np.flatnonzero(a & b | b & c | c & a)


def _cut_edges(faces: IntArray, flagged: BoolArray, vertex_count: int) -> tuple[IntArray, IndexArray]:
    """Ends (E,2) of the flagged edges, and for each edge of each face its number among them or -1: (n,3)."""
    start, end = faces.astype(np.int64), np.roll(faces, -1, axis=1).astype(np.int64)
    key = np.minimum(start, end) * vertex_count + np.maximum(start, end)
    keys = np.unique(key[flagged])
    at = np.minimum(np.searchsorted(keys, key), len(keys) - 1)
    ends = np.stack([keys // vertex_count, keys % vertex_count], axis=1).astype(np.int32)
    return ends, np.where(keys[at] == key, at, -1)


def _cut_faces(faces: IntArray, cut_edge: IndexArray, vertex_count: int) -> tuple[IntArray, IndexArray]:
    """Pieces (P,3) of the faces (n,3) that have edges cut, and the face that each is a piece of (P,)."""
    pieces, owner = [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    cut = cut_edge >= 0
    for pattern, corners in _PATTERNS:
        for turn in range(1 if all(pattern) else 3):
            chosen = np.flatnonzero((cut == np.roll(pattern, turn)).all(axis=1))
            middle = np.roll(cut_edge[chosen], -turn, axis=1) + vertex_count
            both = np.concatenate([np.roll(faces[chosen], -turn, axis=1), middle], axis=1)
            pieces.extend(both[:, piece] for piece in corners)
            owner.extend([chosen] * len(corners))
    return np.concatenate(pieces).astype(np.int32), np.concatenate(owner)


# Corners are 0, 1, 2; the middles of edges 0-1, 1-2, 2-0 are 3, 4, 5.
_PATTERNS: tuple[tuple[tuple[bool, bool, bool], tuple[list[int], ...]], ...] = (
    ((True, False, False), ([0, 3, 2], [3, 1, 2])),
    ((True, True, False), ([3, 1, 4], [0, 3, 4], [0, 4, 2])),
    ((True, True, True), ([0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5])),
)
