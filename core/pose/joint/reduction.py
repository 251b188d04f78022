"""Normal equations of an adjustment by blocks, and their solution with the points eliminated.

Source: Schur complement as in Triggs et al. 2000, section 6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_matrix, csr_matrix, vstack

from ...arrays import FloatArray, IndexArray
from .lens import UNKNOWNS
from .tracks import Tracks


@dataclass(frozen=True, eq=False)
class System:
    """Normal equations of N photos, T points and L adjusted lenses.

    `camera` (N,K,K) and `camera_gradient` (N,K): the photo's six unknowns, and its lens's five where lenses
    are adjusted; `point` (T,3,3), `point_gradient` (T,3); `mixed` (M,K,3) per sighting; `lens` (L,5,5) and
    `lens_gradient` (L,5): what is known of the lenses beforehand; `column` (N,): lens of each photo, or -1.
    """

    camera: FloatArray
    point: FloatArray
    mixed: FloatArray
    camera_gradient: FloatArray
    point_gradient: FloatArray
    lens: FloatArray
    lens_gradient: FloatArray
    column: IndexArray
    cost: float


@dataclass(frozen=True, eq=False)
class Reduced:
    """Equations of poses and lenses alone: `matrix` (Q,Q), `gradient` (Q,), Q = 6 N + 5 L.

    `inverse` (T,3,3) of the points' blocks; `mixed` (Q,3T) couples both.
    """

    matrix: FloatArray
    gradient: FloatArray
    inverse: FloatArray
    mixed: bsr_matrix | csr_matrix


def summing(index: IndexArray, count: int) -> csr_matrix:
    """Matrix (count, M) that adds up the rows that belong to the same index (M,)."""
    return csr_matrix((np.ones(len(index)), (index, np.arange(len(index)))), shape=(count, len(index)))


def sum_groups(groups: csr_matrix, values: FloatArray) -> FloatArray:
    """Sums (count, ...) of values (M, ...) by the matrix of `summing`."""
    width = int(np.prod(values.shape[1:]))
    flat = groups @ values.reshape(len(values), width)
    out: FloatArray = flat.reshape(groups.shape[0], *values.shape[1:])
    return out


def solve_system(tracks: Tracks, system: System, damping: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Damped Gauss-Newton step of the cameras (N,6), the points (T,3) and the lenses (L,5)."""
    reduced = reduce_system(tracks, system, damping)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(reduced.matrix), 1e-300))
    scaled = reduced.matrix * np.outer(scale, scale)
    step = -scale * np.linalg.solve(scaled, scale * reduced.gradient)
    back = system.point_gradient + (reduced.mixed.T @ step).reshape(-1, 3)
    points = -np.einsum("tab,tb->ta", reduced.inverse, back)
    poses = 6 * len(system.camera)
    return step[:poses].reshape(-1, 6), points, step[poses:].reshape(-1, UNKNOWNS)


def reduce_system(tracks: Tracks, system: System, damping: float) -> Reduced:
    """Eliminate the points (Schur complement)."""
    inverse = np.linalg.inv(_damped(system.point, damping) + 1e-9 * np.eye(3))
    outer, gradient = _outer_system(system, damping)
    if not tracks.count:
        return Reduced(outer, gradient, inverse, csr_matrix((len(outer), 0)))
    carried = system.mixed @ inverse[tracks.track]
    mixed = _coupling(system.mixed, tracks, system)
    matrix = -(_coupling(carried, tracks, system) @ mixed.T).toarray()
    eliminated = np.einsum("tab,tb->ta", inverse, system.point_gradient).ravel()
    return Reduced(matrix + outer, gradient - mixed @ eliminated, inverse, mixed)


def _outer_system(system: System, damping: float) -> tuple[FloatArray, FloatArray]:
    """Matrix (Q,Q) and gradient (Q,) of poses and lenses before the points are eliminated."""
    count, lenses = len(system.camera), len(system.lens)
    lens, lens_gradient = system.lens.copy(), system.lens_gradient.copy()
    matrix = np.zeros((6 * count + UNKNOWNS * lenses,) * 2)
    each = np.arange(count)
    poses = np.zeros((count, 6, count, 6))
    poses[each, :, each] = _damped(system.camera[:, :6, :6], damping)
    matrix[: 6 * count, : 6 * count] = poses.reshape(6 * count, 6 * count)
    shared = np.zeros((count, 6, lenses, UNKNOWNS))
    held = np.flatnonzero(system.column >= 0)
    if lenses:
        shared[held, :, system.column[held]] = system.camera[held, :6, 6:]
        np.add.at(lens, system.column[held], system.camera[held, 6:, 6:])
        np.add.at(lens_gradient, system.column[held], system.camera_gradient[held, 6:])
    matrix[: 6 * count, 6 * count :] = shared.reshape(6 * count, -1)
    matrix[6 * count :, : 6 * count] = matrix[: 6 * count, 6 * count :].T
    for number, block in enumerate(_damped(lens, damping)):
        at = slice(6 * count + UNKNOWNS * number, 6 * count + UNKNOWNS * (number + 1))
        matrix[at, at] = block
    return matrix, np.concatenate([system.camera_gradient[:, :6].ravel(), lens_gradient.ravel()])


def _damped(blocks: FloatArray, damping: float) -> FloatArray:
    """Blocks (B,K,K) with their diagonals raised by the share `damping`."""
    diagonal = np.einsum("bkk->bk", blocks)
    out: FloatArray = blocks + damping * diagonal[:, :, None] * np.eye(blocks.shape[1])
    return out


def _coupling(mixed: FloatArray, tracks: Tracks, system: System) -> bsr_matrix | csr_matrix:
    """Sparse matrix (Q,3T) of the mixed blocks (M,K,3)."""
    poses = _blocks(mixed[:, :6], tracks.view, tracks.track, (len(system.camera), tracks.count))
    if not len(system.lens):
        return poses
    lens = system.column[tracks.view]
    held = lens >= 0
    lenses = _blocks(mixed[held, 6:], lens[held], tracks.track[held], (len(system.lens), tracks.count))
    return csr_matrix(vstack([poses, lenses]))


def _blocks(mixed: FloatArray, row: IndexArray, track: IndexArray, shape: tuple[int, int]) -> bsr_matrix:
    """Sparse matrix of blocks (M,K,3) at block rows `row` (M,) and columns `track` (M,)."""
    order = np.lexsort((track, row))
    start = np.searchsorted(row[order], np.arange(shape[0] + 1))
    size = shape[0] * mixed.shape[1], 3 * shape[1]
    return bsr_matrix((mixed[order], track[order], start), shape=size)
