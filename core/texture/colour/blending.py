"""Cross-fading photos near seams: how much of which photo a face takes, at each of its corners.

At a vertex each photo counts by the area of the faces around it that take it; inside a face the shares are
interpolated, so colours are continuous across seams. Spreading the shares over more rings of faces widens the
transition; `bands` says how wide it is for what.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix, diags

from ...arrays import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from ...geometry.meshes import face_normals
from ...geometry.rays import RayCaster, local_centre
from ...geometry.runs import runs
from ...photos.view import View
from ..views.visibility import project


@dataclass(frozen=True, eq=False)
class Blend:
    """N shares: photo `view` (N,) counts on face `face` (N,) with `share` (B,N,3) at its corners.

    Sorted by face; in each of the B bands the shares of a face add up to 1 at each corner.
    """

    face: IndexArray
    view: IntArray
    share: Float32Array


def blend_shares(
    vertices: FloatArray, faces: IntArray, view: IntArray, views: Sequence[View], rings: Sequence[int]
) -> Blend:
    """Shares of the photos on every textured face: (V,3) m, (F,3), chosen photos (F,) -> Blend.

    A photo is blended in only where it sees the face whole. In each band as many `rings` of faces on either
    side of a seam take part; with 0 each face takes its own photo.
    """
    seen = np.flatnonzero(view >= 0)
    if max(rings) <= 0 or len(seen) == 0:
        return Blend(seen, view[seen], np.ones((len(rings), len(seen), 3), np.float32))
    area = face_normals(vertices, faces)[1]
    shares = [_vertex_shares(faces, view, area, len(vertices), len(views), number) for number in rings]
    foreign_face, foreign_view = _other_photos(faces, view, sum(shares[1:], shares[0]))
    sees = _sees(vertices, faces, foreign_face, foreign_view, views)
    face = np.concatenate([seen, foreign_face[sees]])
    number = np.concatenate([view[seen], foreign_view[sees]])
    order = np.lexsort((number, face))
    face, number = face[order], number[order].astype(np.int32)
    own = number == view[face]
    return Blend(face, number, np.stack([_corner_shares(one, faces, face, number, own) for one in shares]))


def _corner_shares(
    shares: csr_matrix, faces: IntArray, face: IndexArray, number: IntArray, own: BoolArray
) -> Float32Array:
    """Shares (N,3) at the corners; photos that do not see the face leave theirs to the others."""
    share = np.stack([_at(shares, faces[face, corner], number) for corner in range(3)], axis=1)
    total = np.stack([np.bincount(face, share[:, k], len(faces)) for k in range(3)], axis=1)[face]
    lonely = total <= 0
    kept: Float32Array = np.where(lonely, own[:, None], share / np.where(lonely, 1, total)).astype(np.float32)
    return kept


def _vertex_shares(
    faces: IntArray, view: IntArray, area: FloatArray, vertex_count: int, view_count: int, rings: int
) -> csr_matrix:
    """Share of every photo at every vertex, spread over rings of faces: sparse (vertices, photos)."""
    seen = np.flatnonzero(view >= 0)
    corner = faces[seen].ravel()
    shape = (vertex_count, view_count)
    shares = csr_matrix((np.repeat(area[seen] + 1e-12, 3), (corner, np.repeat(view[seen], 3))), shape=shape)
    shares = _normalised(shares)
    if rings > 1:
        start, end = faces[seen].ravel(), np.roll(faces[seen], -1, axis=1).ravel()
        ones = np.ones(len(start))
        links = csr_matrix((ones, (start, end)), shape=(vertex_count, vertex_count))
        links = _normalised(links + links.T + diags(np.ones(vertex_count)))
        for _ in range(rings - 1):
            shares = links @ shares
            shares.data[shares.data < 0.01] = 0
            shares.eliminate_zeros()
            shares = _normalised(shares)
    return shares


def _normalised(matrix: csr_matrix) -> csr_matrix:
    total = np.asarray(matrix.sum(axis=1)).ravel()
    normalised: csr_matrix = (diags(1 / np.where(total > 0, total, 1)) @ matrix).tocsr()
    return normalised


def _other_photos(faces: IntArray, view: IntArray, shares: csr_matrix) -> tuple[IndexArray, IntArray]:
    """Faces and photos besides their own that have a share at one of the corners."""
    count = np.diff(shares.indptr)
    mixed = np.flatnonzero((view >= 0) & (count[faces] > 1).any(axis=1))
    vertex = faces[mixed].ravel()
    corner, place = runs(count[vertex])
    face = np.repeat(mixed, 3)[corner]
    number = shares.indices[shares.indptr[vertex[corner]] + place]
    other = number != view[face]
    key = np.unique(face[other].astype(np.int64) * shares.shape[1] + number[other])
    return key // shares.shape[1], (key % shares.shape[1]).astype(np.int32)


def _sees(
    vertices: FloatArray, faces: IntArray, face: IndexArray, view: IntArray, views: Sequence[View]
) -> BoolArray:
    """Whether photo `view` (N,) sees `face` (N,): in frame, from the front, nothing between."""
    keep = np.zeros(len(face), dtype=np.bool_)
    origin = local_centre(vertices)
    caster = RayCaster(vertices - origin, faces)
    for number in np.unique(view):
        chosen = np.flatnonzero(view == number)
        one = views[number]
        corners = vertices[faces[face[chosen]]]
        points = np.concatenate([corners, corners.mean(axis=1, keepdims=True)], axis=1).reshape(-1, 3)
        pixel = project(one, points)
        inside = one.camera.in_frame(pixel)
        mask = one.usable
        if mask is not None:
            at = np.rint(np.where(inside[:, None], pixel, 0)).astype(np.int64)
            inside &= mask[np.clip(at[:, 1], 0, mask.shape[0] - 1), np.clip(at[:, 0], 0, mask.shape[1] - 1)]
        inside[inside] = ~caster.occluded(one.centre - origin, points[inside] - origin)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        facing = np.einsum("nk,nk->n", normal, one.centre - corners[:, 0]) > 0
        keep[chosen] = inside.reshape(-1, 4).all(axis=1) & facing
    return keep


def _at(shares: csr_matrix, row: IntArray, column: IntArray) -> FloatArray:
    """Entries of a sparse matrix, 0 where there is none."""
    values: FloatArray = np.asarray(shares[row, column]).ravel()
    return values
