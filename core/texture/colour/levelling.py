"""Seam levelling: smooth factors that make photos meet without a step where a face's photo changes.

After one gain per photo small steps remain: vignetting, light that depends on direction. Each vertex gets one
factor per photo used around it; steps along seams vanish while factors of one photo vary slowly. Source:
Lempitsky and Ivanov 2007; Waechter, Moehrle and Goesele 2014, section 3.3, written here for factors in linear
light instead of summands, so that a renderer applies it by one multiplication.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, diags
from scipy.sparse.linalg import cg

from ...arrays import ArrayLike, Float32Array, FloatArray, IndexArray, IntArray
from ...geometry.meshes import edge_pairs
from ...jobs import Job, Progress, drain
from ...photos.view import View
from ..selection import Selection
from ..views.images import read_reduced_photo, sample_image, to_linear, to_srgb, view_name
from ..views.visibility import project

_STEPS = np.linspace(0.1, 0.9, 5)
"""Places along a seam's edge at which the two photos are compared."""
_DARK = 0.02
"""Linear value below which a colour says little about a factor."""
_STIFFNESS = 0.1
"""Weight of equal factors along an edge of one photo against agreement along an edge of a seam."""
_MOST = np.log(1.5)
"""Largest log factor: what is beyond is no seam step but detail that does not fit."""


@dataclass(frozen=True, eq=False)
class Knots:
    """One unknown per vertex and photo used around it: `key` (N,) sorted, `of_corner` (F,3) its number."""

    key: IndexArray
    of_corner: IntArray
    vertex_count: int
    links: csr_matrix

    @classmethod
    def of_mesh(cls, faces: IntArray, view: IntArray, vertex_count: int) -> Knots:
        """Find the unknowns of a textured mesh: faces (F,3), their photos (F,)."""
        corner = view[:, None].astype(np.int64) * vertex_count + faces
        seen = view >= 0
        key, index = np.unique(corner[seen], return_inverse=True)
        of_corner = np.zeros(faces.shape, dtype=np.int32)
        of_corner[seen] = index.reshape(-1, 3)
        start = of_corner[seen].ravel()
        end = np.roll(of_corner[seen], -1, axis=1).ravel()
        links = coo_matrix((np.ones(len(start)), (start, end)), shape=(len(key), len(key)))
        return cls(key, of_corner, vertex_count, (links + links.T).tocsr())

    def number(self, view: IntArray, vertex: IntArray) -> IndexArray:
        """Number of the unknown of a photo at a vertex."""
        found: IndexArray = np.searchsorted(self.key, self.key_of(view, vertex))
        return found

    def key_of(self, view: IntArray, vertex: IntArray) -> IndexArray:
        """Value in `key` that stands for a photo at a vertex."""
        return view.astype(np.int64) * self.vertex_count + vertex


@dataclass(frozen=True, eq=False)
class SeamLevels:
    """Factors that level the seams.

    `factor` (F,3,3): linear RGB per corner of a face, on top of the photo's gain; 1 where unseen. `before`
    and `after` are the mean colour steps along the seams in grey levels (of 255), `length` their length, m.
    """

    factor: Float32Array
    knots: Knots
    log_factor: FloatArray
    before: float
    after: float
    length: float

    def at(self, view: IntArray, vertex: IntArray) -> Float32Array:
        """Factors of photos at vertices, shapes that broadcast: -> (...,3), 1 where a photo is not used."""
        view, vertex = np.broadcast_arrays(view, vertex)
        number = np.minimum(self.knots.number(view, vertex), len(self.knots.key) - 1)
        known = self.knots.key[number] == self.knots.key_of(view, vertex)
        factor: Float32Array = np.exp(np.where(known[..., None], self.log_factor[number], 0)).astype(
            np.float32
        )
        return factor


def level_seams(
    vertices: ArrayLike, faces: ArrayLike, selection: Selection, views: Sequence[View]
) -> SeamLevels:
    """Run `level_seams_job` to its end."""
    return drain(level_seams_job(vertices, faces, selection, views))


def level_seams_job(
    vertices: ArrayLike, faces: ArrayLike, selection: Selection, views: Sequence[View]
) -> Job[SeamLevels]:
    """Find the factors for a textured mesh (V,3) m, (F,3). Photos along seams are read once more, reduced.

    Raises PhotoError when a photo has disappeared.
    """
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int32)
    yield Progress(0.0, "Finding seams")
    seams = _find_seams(points, triangles, selection.view)
    knots = Knots.of_mesh(triangles, selection.view, len(points))
    colour = np.zeros((2, len(seams.edge), len(_STEPS), 3))
    for number in np.unique(seams.view):
        yield Progress(0.1 + 0.6 * number / len(views), f"Reading {view_name(views[number], int(number))}")
        _sample_seams(colour, points, seams, views[number], int(number), selection.gain[number])
    yield Progress(0.7, "Levelling seams")
    log_factor = np.stack([_solve(knots, seams, colour[..., c]) for c in range(3)], axis=1)
    factor = np.ones((len(triangles), 3, 3), dtype=np.float32)
    seen = selection.view >= 0
    factor[seen] = np.exp(log_factor)[knots.of_corner[seen]]
    length = np.linalg.norm(points[seams.edge[:, 0]] - points[seams.edge[:, 1]], axis=1)
    return SeamLevels(
        factor,
        knots,
        log_factor,
        _mean_step(colour, length),
        _mean_step(colour * np.exp(_along(log_factor, knots, seams)), length),
        float(length.sum()),
    )


@dataclass(frozen=True, eq=False)
class _Seams:
    """Edges (S,2) where two photos meet: `view` (2,S), the photo on either side."""

    edge: IntArray
    view: IntArray


def _find_seams(points: FloatArray, faces: IntArray, view: IntArray) -> _Seams:
    pairs = edge_pairs(faces, len(points))
    sides = view[pairs.face]
    seam = (sides[:, 0] != sides[:, 1]) & (sides >= 0).all(axis=1)
    return _Seams(pairs.vertex[seam], sides[seam].T.copy())


def _sample_seams(
    colour: FloatArray, points: FloatArray, seams: _Seams, view: View, number: int, gain: FloatArray
) -> None:
    """Fill in the linear colours (2,S,P,3) along seams on the sides where photo `number` lies."""
    photo, scale = read_reduced_photo(view, np.inf)
    for side in range(2):
        chosen = np.flatnonzero(seams.view[side] == number)
        a, b = points[seams.edge[chosen, 0]], points[seams.edge[chosen, 1]]
        along = a[:, None] + _STEPS[:, None] * (b - a)[:, None]
        pixel = (project(view, along.reshape(-1, 3)) + 0.5) * scale - 0.5
        linear = to_linear(sample_image(photo, np.nan_to_num(pixel))) * gain
        colour[side, chosen] = linear.reshape(len(chosen), len(_STEPS), 3)


def _solve(knots: Knots, seams: _Seams, colour: FloatArray) -> FloatArray:
    """Log factors (N,) of one channel; `colour` (2,S,P) linear along the seams.

    Minimises `sum w (g_l - g_r + log(c_l / c_r))²` over the ends of seam edges plus the stiffness times
    `sum (g_i - g_j)²` over edges within a photo, by conjugate gradients.
    """
    count = len(knots.key)
    mean = np.stack([colour @ (1 - _STEPS), colour @ _STEPS], axis=2) / (len(_STEPS) / 2)  # (2,S,ends)
    weight = np.prod(mean / (mean + _DARK), axis=0)
    target = np.clip(np.log((mean[1] + 1e-4) / (mean[0] + 1e-4)), -_MOST, _MOST)
    left = knots.number(np.repeat(seams.view[0], 2), seams.edge.ravel())
    right = knots.number(np.repeat(seams.view[1], 2), seams.edge.ravel())
    rows = np.tile(np.arange(len(left)), 2)
    values = np.concatenate([np.ones(len(left)), -np.ones(len(left))])
    jump = coo_matrix((values, (rows, np.concatenate([left, right]))), shape=(len(left), count)).tocsr()
    scaled = diags(weight.ravel()) @ jump
    stiffness = diags(np.asarray(knots.links.sum(axis=1)).ravel()) - knots.links
    normal = (jump.T @ scaled + _STIFFNESS * stiffness + 1e-4 * diags(np.ones(count))).tocsr()
    right_side = scaled.T @ target.ravel()
    start = np.zeros(count)
    solution = cg(normal, right_side, x0=start, rtol=1e-4, maxiter=300, M=diags(1 / normal.diagonal()))[0]
    log_factor: FloatArray = np.clip(solution, -_MOST, _MOST)
    return log_factor


def _along(log_factor: FloatArray, knots: Knots, seams: _Seams) -> FloatArray:
    """Log factors along the seams, interpolated between the ends of each edge: (2,S,P,3)."""
    ends = np.stack([log_factor[knots.number(seams.view[side][:, None], seams.edge)] for side in range(2)])
    steps = _STEPS[:, None]
    along: FloatArray = ends[:, :, None, 0] * (1 - steps) + ends[:, :, None, 1] * steps
    return along


def _mean_step(colour: FloatArray, length: FloatArray) -> float:
    """Mean step across the seams in grey levels: linear colours (2,S,P,3), lengths (S,)."""
    if len(length) == 0:
        return 0.0
    srgb = to_srgb(colour) * 255
    step = np.abs(srgb[0] - srgb[1]).mean(axis=(1, 2))
    return float(np.average(step, weights=length))
