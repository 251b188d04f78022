"""Move a pose until the scan's edges fall on the photo's: matching along normals, solved robustly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import BoolArray, FloatArray, IndexArray
from ...cameras.base import Camera
from ...geometry.rigid import log_so3
from ..points.perturbation import camera_point_jacobian, camera_points, invert_scaled, solve_scaled, step_pose
from .photo_edges import EdgeField
from .scan_edges import ScanEdges

SAMPLES_PER_PIXEL = 2
"""Samples of the photo's edges per pixel along a normal."""

MATCH_SIGMA = 0.5
"""Standard deviation (px) of one match of an edge."""

COMMON_SIGMA = 0.2
"""Standard deviation (px) that the edges of one cell share."""

MATCHED = 0.25
"""Weight from which an edge of the scan counts as found in the photo."""

SHARPEST = 0.4
"""Smallest distance (px) at which a match of width 1 is doubted: edges are placed no better."""

CELLS = 8
"""The photo is cut into so many cells a side; errors within one are alike."""


@dataclass(frozen=True, eq=False)
class PosePrior:
    """A pose known beforehand: rotation (3,3), centre (3,) m, covariance (6,6) as in `Pose`."""

    rotation: FloatArray
    centre: FloatArray
    covariance: FloatArray

    def pull(self, rotation: FloatArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Information (6,6) and gradient (6,) at another pose; a far one is pulled less (Cauchy)."""
        information = invert_scaled(self.covariance)
        step = np.concatenate([log_so3(rotation @ self.rotation.T), centre - self.centre])
        weight = 1.0 / (1.0 + float(step @ information @ step) / 24.0)
        return weight * information, weight * information @ step


@dataclass(frozen=True, eq=False)
class Matches:
    """Photo edges found along the normals of scan edges: signed `distance` (N,) px and `weight` (N,)."""

    distance: FloatArray
    weight: FloatArray


@dataclass(frozen=True, eq=False)
class Alignment:
    """A pose that fits edges.

    `edge_errors` (6,6): the part of the covariance that comes from the edges, not from the prior; `matched`:
    edge points that found a partner, `visible`: all of them; `cells` (K,): numbers of the photo cells that
    hold matched ones.
    """

    rotation: FloatArray
    centre: FloatArray
    covariance: FloatArray
    edge_errors: FloatArray
    matched: int
    visible: int
    cells: IndexArray

    def widened(self, factor: float) -> FloatArray:
        """Covariance (6,6) of this pose when the edges' variances are `factor` times as large, at least 1."""
        out: FloatArray = self.covariance + (max(factor, 1.0) - 1.0) * self.edge_errors
        return out


def match_edges(
    field: EdgeField, pixels: FloatArray, normals: FloatArray, width: float, search: float
) -> Matches:
    """Mean position of the photo's edges of the right direction, within about `width` px along each normal.

    Every sample along the normal takes part by its strength, direction and distance, so that two edges side
    by side share the match while the pose is rough and the nearer one wins as `width` shrinks.
    Source: ICP with soft assignment, Granger and Pennec 2002 (EM-ICP).
    """
    reach = (
        np.arange(-int(search * SAMPLES_PER_PIXEL), int(search * SAMPLES_PER_PIXEL) + 1) / SAMPLES_PER_PIXEL
    )
    samples = pixels[:, None, :] + reach[:, None] * normals[:, None, :]
    strength = np.maximum(field.along(samples, normals), 0.0)
    # what is everywhere along the normal (texture) tells nothing
    strength = np.maximum(strength - strength.sum(axis=1, keepdims=True) / len(reach), 0.0)
    near = strength * np.exp(-0.5 * (reach / width) ** 2)
    weight = near.sum(axis=1)
    distance = (near @ reach) / np.maximum(weight, 1e-9)
    return Matches(distance, weight / SAMPLES_PER_PIXEL)


@dataclass(frozen=True, eq=False)
class Photo:
    """One image level: its camera, its edges, and what may be wrong with matches there.

    `search`: reach of the matching (px); `doubt`: width (px) of the matching that judges how far the edges of
    a part of the photo may be off together.
    """

    camera: Camera
    field: EdgeField
    search: float
    doubt: float


def align_edges(
    photo: Photo,
    edges: ScanEdges,
    rotation: FloatArray,
    centre: FloatArray,
    prior: PosePrior,
    widths: tuple[float, ...],
) -> Alignment:
    """Gauss-Newton steps with ever narrower matching. Source: method.md 2.6, eq. 3.31."""
    for width in widths:
        inflation, _ = _inflations(photo, edges, rotation, centre, width)
        for _ in range(8):
            system = _linearise(photo, edges, rotation, centre, width)
            step = _fused_step(system, inflation, prior, rotation, centre)
            rotation, centre = step_pose(rotation, centre, step)
            if float(np.abs(system.jacobian @ step).max(initial=0.0)) < 0.05:
                break
    system = _linearise(photo, edges, rotation, centre, widths[-1])
    information, _ = prior.pull(rotation, centre)
    by_cells, by_pieces = _inflations(photo, edges, rotation, centre, widths[-1])
    gain = invert_scaled(system.hessian / by_cells + information)
    edge_errors = gain @ (system.hessian / by_cells) @ gain * max(1.0, by_pieces / by_cells)
    return Alignment(
        rotation,
        centre,
        gain @ information @ gain + edge_errors,
        edge_errors,
        int(system.matched.sum()),
        len(system.matched),
        system.cells,
    )


@dataclass(frozen=True, eq=False)
class _System:
    """Normal equations of the matches; what each adds to the gradient, its cell, its piece, if it counts."""

    jacobian: FloatArray
    hessian: FloatArray
    pulls: FloatArray
    cell: IndexArray
    piece: IndexArray
    matched: BoolArray

    @property
    def cells(self) -> IndexArray:
        """Numbers (K,) of the photo cells that hold the pose."""
        return np.flatnonzero(np.bincount(self.cell[self.matched], minlength=1) >= 5)

    def spread(self, group: IndexArray) -> FloatArray:
        """Covariance (6,6) of the gradient when the edges of a `group` (N,) err together."""
        used, index = np.unique(group, return_inverse=True)
        sums = np.zeros((len(used), 6))
        np.add.at(sums, index, self.pulls)
        out: FloatArray = sums.T @ sums * len(used) / max(len(used) - 6, 1)
        return out


def _inflations(
    photo: Photo, edges: ScanEdges, rotation: FloatArray, centre: FloatArray, width: float
) -> tuple[float, float]:
    """Factors on the covariance at `width` from the disagreement of cells and of edge pieces, at least 1.

    Edges of one cell err together (a worn cornice, a shadow), and so do those of one piece of edge, however
    long: their pulls are the independent ones. Cells weigh edges against the prior; the result's errors are
    those of the pieces where they disagree more. Of a noisy scan pulls are taken with wide matching: a narrow
    one finds some edge near every place and hides what a whole cell is off. Source: cluster-robust
    ("sandwich") variance, Liang and Zeger 1986, its mean over the unknowns.
    """
    wide = _linearise(photo, edges, rotation, centre, max(width, photo.doubt))
    narrow = _linearise(photo, edges, rotation, centre, width)
    inverse = invert_scaled(wide.hessian)
    ratio = float(np.trace(inverse @ narrow.hessian)) / 6.0
    by_cells, by_pieces = (
        max(1.0, ratio * float(np.trace(inverse @ wide.spread(group))) / 6.0)
        for group in (wide.cell, wide.piece)
    )
    return by_cells, by_pieces


def _linearise(
    photo: Photo, edges: ScanEdges, rotation: FloatArray, centre: FloatArray, width: float
) -> _System:
    in_camera = camera_points(rotation, centre, edges.points)
    pixels, by_point = photo.camera.project_with_jacobian(in_camera)
    usable = np.isfinite(pixels).all(axis=1) & photo.camera.in_frame(pixels, margin=2.0)
    pixels, normals = pixels[usable], edges.normals[usable]
    by_pose = by_point[usable] @ camera_point_jacobian(rotation, in_camera[usable])
    jacobian = np.einsum("ni,nik->nk", normals, by_pose)
    matches = match_edges(photo.field, pixels, normals, width, photo.search)
    cell = _cells(photo.camera, pixels)
    weight = _weights(matches.weight * edges.strength[usable], cell) * _trust(matches, width)
    hessian = (jacobian * weight[:, None]).T @ jacobian
    pulls = (weight * -matches.distance)[:, None] * jacobian
    return _System(jacobian, hessian, pulls, cell, edges.piece[usable], matches.weight > MATCHED)


def _trust(matches: Matches, width: float) -> FloatArray:
    """Weight (N,) of each match by its distance against the usual one; hardly any while matching is wide.

    An edge that the photo does not show finds its neighbour instead, which lies off.
    Source: Geman and McClure 1985, with the scale from the median absolute deviation.
    """
    found = matches.weight > MATCHED
    usual = 1.483 * float(np.median(np.abs(matches.distance[found]))) if found.any() else 0.0
    scale = max(2.0 * usual, SHARPEST * width**2)
    out: FloatArray = 1.0 / (1.0 + (matches.distance / scale) ** 2) ** 2
    return out


def _weights(strength: FloatArray, cell: IndexArray) -> FloatArray:
    """Information (1/px^2) of each match: its strength relative to the usual one, at most twice that.

    However many edges a cell has, they never tell more than what they may err in common allows.
    """
    usual = float(np.median(strength[strength > 0])) if (strength > 0).any() else 1.0
    count = np.minimum(strength / usual, 2.0)
    total = np.bincount(cell, count, minlength=CELLS * CELLS)
    weight: FloatArray = count / (MATCH_SIGMA**2 + COMMON_SIGMA**2 * total[cell])
    return weight


def _cells(camera: Camera, pixels: FloatArray) -> IndexArray:
    size = np.array([camera.width, camera.height]) / CELLS
    column, row = np.clip((pixels // size).astype(np.int64), 0, CELLS - 1).T
    out: IndexArray = row * CELLS + column
    return out


def _fused_step(
    system: _System, inflation: float, prior: PosePrior, rotation: FloatArray, centre: FloatArray
) -> FloatArray:
    information, pull = prior.pull(rotation, centre)
    hessian = system.hessian / inflation + information
    return -solve_scaled(hessian, system.pulls.sum(axis=0) / inflation + pull, damping=1e-9)


def edge_agreement(photo: Photo, edges: ScanEdges, rotation: FloatArray, centre: FloatArray) -> float:
    """How much stronger the photo's edges are where the scan's fall than beside them; 1: no relation."""
    pixels = photo.camera.project(camera_points(rotation, centre, edges.points))
    usable = np.isfinite(pixels).all(axis=1) & photo.camera.in_frame(pixels, margin=2.0)
    if not usable.any():
        return 0.0
    normals = edges.normals[usable]
    reach = np.linspace(-photo.search, photo.search, 8 * int(photo.search) + 1)
    samples = pixels[usable][:, None, :] + reach[:, None] * normals[:, None, :]
    strength = np.maximum(photo.field.along(samples, normals), 0.0) * edges.strength[usable][:, None]
    centred = np.exp(-0.5 * reach**2)
    here = float((strength @ centred).sum()) / float(centred.sum())
    return here / max(float(strength.mean(axis=1).sum()), 1e-9)
