"""Likeness of a photo's edges with patches of the scan's edges, for every shift of a patch in the photo."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ...arrays import Float32Array, FloatArray, IndexArray
from ..points.perturbation import camera_point_jacobian, camera_points
from .alignment import Photo, PosePrior
from .scan_edges import ScanEdges

PATCH = 32
"""Side (px) of a patch; the next one begins half a side farther."""

FEWEST = 12
"""Edge points that a patch needs to be looked for."""

MOST = 300
"""Patches that vote; of more, some are drawn."""

USUAL = 0.02
"""Smallest spread of likeness (a correlation) over the shifts of a patch that is told from none."""

CLEAREST = 4.0
"""A patch counts at most so many spreads above its mean: no patch decides alone."""


@dataclass(frozen=True, eq=False)
class PatchMaps:
    """Patches of the scan's edges and how well each fits the photo when it is shifted.

    `likeness` (K,S,S): by shift along rows and columns from -`reach` to `reach` px, in spreads above the
    patch's mean; `jacobian` (K,2,6): shift (px) of each patch by a step of the pose.
    """

    likeness: Float32Array
    jacobian: FloatArray
    reach: int

    def __len__(self) -> int:
        return len(self.likeness)

    def smoothed(self, sigma: float) -> PatchMaps:
        """Return the maps with peaks made wider by `sigma` px."""
        wide = [cv2.GaussianBlur(one, (0, 0), sigma) for one in self.likeness]
        return replace(self, likeness=np.array(wide, dtype=np.float32))

    def fit(self, steps: FloatArray) -> FloatArray:
        """Mean likeness (M,) of all patches where steps (M,6) of the pose shift them; 0 beyond reach."""
        size = 2 * self.reach + 1
        shift = np.einsum("kij,mj->mki", self.jacobian, steps)
        inside = (np.abs(shift) <= self.reach).all(axis=2)
        column, row = np.clip(shift + self.reach, 0, size - 1.001).transpose(2, 0, 1)
        # one map below the other, so that one call looks all of them up
        below = (row + size * np.arange(len(self))).astype(np.float32)
        flat = self.likeness.reshape(-1, size)
        found = cv2.remap(flat, column.astype(np.float32), below, cv2.INTER_LINEAR)
        out: FloatArray = np.where(inside, found, 0.0).mean(axis=1, dtype=np.float64)
        return out

    def apart(self, steps: FloatArray, other: FloatArray) -> FloatArray:
        """Root mean square distance (M,) in px between patches at steps (M,6) and at another one (6,)."""
        squares = np.einsum("kij,kil->jl", self.jacobian, self.jacobian) / max(len(self), 1)
        way = steps - other
        out: FloatArray = np.sqrt(np.maximum(((way @ squares) * way).sum(axis=1), 0.0))
        return out


def shift_sigma(photo: Photo, edges: ScanEdges, prior: PosePrior) -> float:
    """Median standard deviation (px per axis) of where edges lie in the photo; 0 without edges."""
    jacobian = _shift_jacobian(photo, edges, prior)
    variance = np.einsum("nik,kl,nil->n", jacobian, prior.covariance, jacobian) / 2
    return float(np.sqrt(np.median(variance))) if len(edges) else 0.0


def patch_maps(
    photo: Photo, edges: ScanEdges, prior: PosePrior, reach: int, rng: np.random.Generator
) -> PatchMaps:
    """Maps of patches of `edges`, which are seen from the prior's pose, for shifts of up to `reach` px.

    Likeness is the normalised cross-correlation of edge strength in double-angle form, so that edges of
    another direction count against a shift.
    """
    jacobian = _shift_jacobian(photo, edges, prior)
    drawn = _drawn(edges, photo)
    border = [(reach, reach), (reach, reach), (0, 0)]
    field = np.pad(np.dstack([photo.field.cosine, photo.field.sine]), border)
    likeness, by_pose = [], []
    patches = _patches(edges, photo)
    if len(patches) > MOST:
        patches = [patches[k] for k in np.sort(rng.choice(len(patches), MOST, replace=False))]
    for left, top, inside in patches:
        template = drawn[top : top + PATCH, left : left + PATCH]
        window = field[top : top + PATCH + 2 * reach, left : left + PATCH + 2 * reach]
        likeness.append(_likeness(window, template))
        weight = edges.strength[inside] / edges.strength[inside].sum()
        by_pose.append(np.einsum("n,nik->ik", weight, jacobian[inside]))
    size = 2 * reach + 1
    maps = np.array(likeness, dtype=np.float32).reshape(-1, size, size)
    return PatchMaps(maps, np.array(by_pose).reshape(-1, 2, 6), reach)


def _shift_jacobian(photo: Photo, edges: ScanEdges, prior: PosePrior) -> FloatArray:
    """Shift (N,2,6) in px of each edge point by a step of the pose."""
    in_camera = camera_points(prior.rotation, prior.centre, edges.points)
    by_point = photo.camera.project_with_jacobian(in_camera)[1]
    out: FloatArray = by_point @ camera_point_jacobian(prior.rotation, in_camera)
    return out


def _drawn(edges: ScanEdges, photo: Photo) -> Float32Array:
    """Scan edges drawn like `EdgeField`: double-angle form (H,W,2)."""
    height, width = photo.camera.height, photo.camera.width
    column, row = np.clip(np.rint(edges.pixels).astype(np.int64), 0, [width - 1, height - 1]).T
    x, y = edges.normals.T
    drawn = np.zeros((height, width, 2), np.float32)
    drawn[row, column] = edges.strength[:, None] * np.stack([x**2 - y**2, 2 * x * y], axis=1)
    out: Float32Array = cv2.GaussianBlur(drawn, (0, 0), 1.0).astype(np.float32)
    return out


def _patches(edges: ScanEdges, photo: Photo) -> list[tuple[int, int, IndexArray]]:
    """Left and top pixel of every patch with enough edge points, and which these are."""
    x, y = edges.pixels.T
    found = []
    for top in range(0, photo.camera.height - PATCH + 1, PATCH // 2):
        level = np.flatnonzero((y >= top) & (y < top + PATCH))
        for left in range(0, photo.camera.width - PATCH + 1, PATCH // 2):
            inside = level[(x[level] >= left) & (x[level] < left + PATCH)]
            if len(inside) >= FEWEST:
                found.append((left, top, inside))
    return found


def _likeness(window: Float32Array, template: Float32Array) -> Float32Array:
    """Normalised correlation at every place of a template in a window, in spreads above its mean."""
    found = cv2.matchTemplate(
        np.ascontiguousarray(window), np.ascontiguousarray(template), cv2.TM_CCORR_NORMED
    )
    # where the photo has no edges at all OpenCV divides by nothing
    found = np.where(np.isfinite(found) & (np.abs(found) <= 1.01), found, 0.0)
    out: Float32Array = np.clip((found - found.mean()) / (found.std() + USUAL), -1.0, CLEAREST)
    return out
