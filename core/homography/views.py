"""A region as one camera sees it, and how far off another camera's outline of it falls there."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..arrays import FloatArray, IndexArray
from ..cameras.base import Camera
from ..errors import RegionError
from ..geometry.charts import Chart, chart_around
from ..geometry.moments import (
    boundary_gram,
    edge_moments,
    edge_nodes,
    moment_derivatives,
    moments_from_nodes,
    monomials,
)
from ..geometry.outlines import fill_edges
from ..pose.regions.contour import ImageContour, image_contour
from ..pose.regions.initial import normalised_shape
from ..pose.regions.moment_pair import Edges
from ..pose.regions.problem import check_image_region, touches_frame
from ..regions import ImageRegion
from ..regions.image_region import described

ORDER = 6
"""Order of the moments; a homography has eight unknowns where a pose has six."""

SMOOTHNESS = 0.01  # α of the whitening, in units of the region's spread
_HALF_WIDTH = 4  # pixels of outline to either side that are smoothed together
_STRAIGHT = 0.015  # of an outline's length, by which a straight side may be off
_ROUND = 0.02  # of its radius, by which a circle may be off
_SAMPLES = 500  # points that an outline is thinned to
_FEW = 12  # points of an outline that stand for all
_RASTER = 250.0  # cells along a region: the root of its area


@dataclass(frozen=True, eq=False)
class RegionView:
    """A region in one photo: its outline in pixels, in rays, and flat in a chart of its own.

    `rays` (n,3) are the outline's directions, point i joined to `following[i]`; `edges` these in the chart;
    `moments` (28,) up to `ORDER` and their `whitening`; `size` the root of the region's area in pixels.
    """

    camera: Camera
    contour: ImageContour
    rays: FloatArray
    following: IndexArray
    chart: Chart
    edges: Edges
    moments: FloatArray
    whitening: FloatArray
    size: float

    @property
    def middle(self) -> FloatArray:
        """Direction (3,) of the region's centroid, roughly."""
        mean: FloatArray = self.rays.mean(axis=0)
        return mean / np.linalg.norm(mean)


def region_view(camera: Camera, region: ImageRegion) -> RegionView:
    """Read a region of a photo.

    Raises
    ------
    RegionError
        The region is cut off by the frame, too small, no patch, or does not fit the photo.
    """
    check_image_region(camera, region)
    if touches_frame(camera, region):
        raise RegionError(
            f"{described(region.name)} touches the edge of the photo: part of its outline is missing; "
            "mark one that is wholly visible."
        )
    contour = image_contour(region.loops, region.hidden, _HALF_WIDTH)
    chosen, following = _thinned(region)
    rays = camera.unproject(contour.points[chosen])
    if not np.all(np.isfinite(rays)):
        raise RegionError(f"{described(region.name)} reaches beyond the field of the camera's lens model.")
    chart = chart_around(rays)
    flat = chart.flatten(rays)
    edges = (flat, flat[following])
    try:
        whitening = np.linalg.inv(np.linalg.cholesky(boundary_gram(*edges, ORDER, SMOOTHNESS)))
    except np.linalg.LinAlgError as error:
        raise RegionError(f"{described(region.name)} is no patch: its outline is a line.") from error
    return RegionView(
        camera, contour, rays, following, chart, edges, edge_moments(*edges, ORDER), whitening,
        float(np.sqrt(region.area)),
    )  # fmt: skip


def fits_itself(view: RegionView) -> bool:
    """Whether the outline is a triangle or an oval: many homographies bring it onto itself."""
    if np.count_nonzero(view.following <= np.arange(len(view.following))) > 1:
        return False  # several outlines hold each other
    outline = view.edges[0].astype(np.float32)
    if len(cv2.approxPolyDP(outline, _STRAIGHT * cv2.arcLength(outline, True), True)) <= 3:
        return True
    _, (flat, _) = normalised_shape(view.edges)
    radius = np.linalg.norm(flat, axis=1)  # normalised, an oval is a circle
    return float(np.std(radius)) < _ROUND * float(np.mean(radius))


def _thinned(region: ImageRegion) -> tuple[IndexArray, IndexArray]:
    """Points of the smoothed outline to keep (n,), and the number (n,) of the one that follows each."""
    lengths = [_contour_length(loop) for loop in region.loops]
    stride = max(1, sum(lengths) // _SAMPLES)
    chosen, following, first, count = [], [], 0, 0
    for length in lengths:
        kept = np.arange(0, length, min(stride, max(1, length // 8)), dtype=np.int64)
        chosen.append(first + kept)
        following.append(count + (np.arange(len(kept)) + 1) % len(kept))
        first, count = first + length, count + len(kept)
    return np.concatenate(chosen), np.concatenate(following)


def _contour_length(loop: FloatArray) -> int:
    """Number of points that `image_contour` gives an outline."""
    steps = np.roll(loop, -1, axis=0) - loop
    if np.all(np.abs(steps).sum(axis=1) == 1.0):
        return len(loop)
    return max(8, round(float(np.linalg.norm(steps, axis=1).sum())))


def sampled_rays(view: RegionView) -> FloatArray:
    """Few rays (n,3) of a region: on its outline, half-way to its middle, and there."""
    around = view.rays[:: max(1, len(view.rays) // _FEW)]
    return np.concatenate([around, 0.5 * (around + view.middle), view.middle[None]])


def moment_count(order: int) -> int:
    """Number of moments up to an order."""
    return (order + 1) * (order + 2) // 2


def moment_residuals(
    view: RegionView, rays: FloatArray, rates: FloatArray, following: IndexArray, order: int
) -> tuple[FloatArray, FloatArray]:
    """Whitened differences of moments and their derivative: (e,), (e,P).

    `rays` (n,3) are the outline of another view brought here, `rates` (n,3,P) their derivatives. NaN where
    they come to lie behind. Source: method.md 5, with whitening in place of the norms N_i.
    """
    flat, slope = view.chart.flatten_with_jacobian(rays)
    moved = slope @ rates
    values = monomials(edge_nodes(flat, flat[following]), order)
    moments = moments_from_nodes(values, flat, flat[following], order)
    jacobian = moment_derivatives(values, flat, flat[following], moved, moved[following])
    count = moment_count(order)  # the leading block of a triangular inverse is the inverse of that block
    whitening = view.whitening[:count, :count]
    return whitening @ (moments - view.moments[:count]), whitening @ jacobian


def outline_distances(
    view: RegionView, rays: FloatArray, rates: FloatArray, following: IndexArray
) -> tuple[FloatArray, FloatArray]:
    """Distance (n,) px of mapped points from the outline here, NaN if none belongs, and slopes (n,P)."""
    pixels, slope = view.camera.project_with_jacobian(rays)
    seen = np.all(np.isfinite(pixels), axis=1)
    nearest = view.contour.tree.query(np.where(seen[:, None], pixels, 0.0))[1]
    normals = view.contour.normals[nearest]
    distances = np.sum(normals * (pixels - view.contour.points[nearest]), axis=1)
    along = pixels[following] - pixels
    outwards = np.stack([along[:, 1], -along[:, 0]], axis=1)
    outwards /= np.maximum(np.linalg.norm(outwards, axis=1, keepdims=True), 1e-12)
    usable = seen & (np.sum(outwards * normals, axis=1) > 0.7) & (view.contour.weights[nearest] > 0)
    jacobian = np.einsum("ni,nij,njp->np", normals, slope, rates)
    return np.where(usable, distances, np.nan), np.where(usable[:, None], jacobian, 0.0)


def overlap_error(view: RegionView, rays: FloatArray, following: IndexArray) -> float:
    """Overlap error δ in percent of a mapped outline (n,3): `100 |A xor B| / (|A| + |B|)`."""
    flat = view.chart.flatten(rays)
    if not np.all(np.isfinite(flat)):
        return 100.0
    scale = _RASTER / np.sqrt(abs(view.moments[0]))
    low = view.edges[0].min(axis=0) - 0.3
    width, height = np.ceil((view.edges[0].max(axis=0) + 0.3 - low) * scale).astype(int)
    here = fill_edges((view.edges[0] - low) * scale, (view.edges[1] - low) * scale, width, height)
    mapped = (flat - low) * scale
    there = fill_edges(mapped, mapped[following], width, height)
    total = np.count_nonzero(here) + np.count_nonzero(there)
    return 100.0 * float(np.count_nonzero(here != there)) / max(total, 1)
