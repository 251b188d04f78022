"""Edges of the scan and ties as a photo should show them, and how far off it shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray
from ...cameras.base import Camera
from ...geometry.rigid import camera_centre, exp_so3, log_so3
from ...jobs import Job, Progress, drain
from ...photos.view import View
from ...pose.edges.alignment import match_edges
from ...pose.edges.photo_edges import EdgeField, photo_edge_field
from ...pose.edges.rendering import EdgeScan
from ...pose.edges.scan_edges import ScanEdges, find_scan_edges
from ...pose.joint import TieResiduals
from ...pose.points.pictures import read_view, read_view_mask
from ...scans.scan import Scan
from ...settings import EdgeSettings
from .photo_pose import Refinement
from .refinement import scan_colours

_WIDTHS = (4.0, 1.0)
"""Widths (pixels of the reduced photo) of the matching: the second time from where the first one led."""

_FOUND = 0.25
"""Weight of a match from which an edge of the photo counts as found."""


@dataclass(frozen=True, eq=False)
class EdgeResiduals:
    """Visible edges of the scan, cut into short segments, and where the photo shows them.

    `segments` (N,2,3) in the scan's local coordinates, m. `pixels` (N,2) of their middles in the photo;
    `offsets` (N,2) from there to the photo's edge, px, NaN where it shows none. (0, 0) is the centre of the
    top-left pixel.
    """

    segments: FloatArray
    pixels: FloatArray
    offsets: FloatArray

    @property
    def median(self) -> float:
        """Median length of the residuals in pixels; NaN without any."""
        length = np.linalg.norm(self.offsets, axis=1)
        found = np.isfinite(length)
        return float(np.median(length[found])) if found.any() else float("nan")

    def projected(self, camera: Camera, rotation: FloatArray, translation: FloatArray) -> FloatArray:
        """Segments (M,2,2) in pixels from a pose (3,3), (3,); those outside its view are left out."""
        points = self.segments.reshape(-1, 3) @ rotation.T + translation
        pixels = camera.project(points).reshape(-1, 2, 2)
        long = np.linalg.norm(pixels[:, 1] - pixels[:, 0], axis=1) > 0.25 * camera.width  # a panorama's seam
        seen: FloatArray = pixels[np.isfinite(pixels).all(axis=(1, 2)) & ~long]
        return seen


def edge_residuals(view: View, scan: Scan, settings: EdgeSettings | None = None) -> EdgeResiduals:
    """Run `edge_residuals_job` to its end."""
    return drain(edge_residuals_job(view, scan, settings))


def edge_residuals_job(view: View, scan: Scan, settings: EdgeSettings | None = None) -> Job[EdgeResiduals]:
    """Find the edges of the scan that a posed photo should show, and the photo's own beside them.

    `view` is in the scan's local coordinates. Raises PhotoError for a photo that cannot be read.
    Source: method.md 2.6; the matching is that of the refinement by edges.
    """
    settings = settings or EdgeSettings()
    yield Progress(0.0, "Preparing the scan")
    origin = scan.vertices.mean(axis=0)
    mesh = EdgeScan.of_mesh(scan.vertices - origin, scan.faces, scan_colours(scan))
    scale = min(1.0, settings.photo_size / max(view.camera.width, view.camera.height))
    camera, centre = view.camera.scaled(scale), view.centre - origin
    yield Progress(0.3, "Finding the edges of the scan")
    edges = find_scan_edges(camera, view.rotation, centre, mesh, settings)
    edges = edges.select(np.arange(0, len(edges), max(1, len(edges) // (2 * settings.max_edges))))
    yield Progress(0.7, "Finding the edges of the photo")
    field = photo_edge_field(read_view(view, scale), read_view_mask(view, scale))
    offsets = _offsets(field, edges, settings.search)
    along = 0.7 * edges.normals[:, ::-1] * (-1.0, 1.0)  # a little more than half a pixel: no gaps between
    distance = np.linalg.norm(edges.points - centre, axis=1)[:, None]
    ends = [centre + distance * (camera.unproject(edges.pixels + s * along) @ view.rotation) for s in (-1, 1)]
    segments = np.stack(ends, axis=1) + origin
    known = np.isfinite(segments).all(axis=(1, 2))
    pixels = (edges.pixels + 0.5) / scale - 0.5
    return EdgeResiduals(segments[known], pixels[known], offsets[known] / scale)


def _offsets(field: EdgeField, edges: ScanEdges, search: float) -> FloatArray:
    """From the scan's edges to the photo's: (N,2) px along the normals, NaN where there is none."""
    distance, found = np.zeros(len(edges)), np.zeros(len(edges))
    for width in _WIDTHS:
        pixels = edges.pixels + distance[:, None] * edges.normals
        matches = match_edges(field, pixels, edges.normals, width, search)
        distance, found = distance + matches.distance, matches.weight
    known = (found > _FOUND) & (np.abs(distance) <= search)
    out: FloatArray = edges.normals * np.where(known, distance, np.nan)[:, None]
    return out


def tie_residuals(refinements: Sequence[Refinement]) -> TieResiduals | None:
    """What the joint refinement left of some ties all over a photo; None where it did not move it last."""
    moved = [step for step in refinements if step.moved]
    if not moved or not moved[-1].ties:
        return None
    numbers = np.array(moved[-1].ties)
    return TieResiduals(numbers[:, :2], numbers[:, 2:])


def pose_between(
    first: tuple[FloatArray, FloatArray], second: tuple[FloatArray, FloatArray], share: float
) -> tuple[FloatArray, FloatArray]:
    """Pose (3,3), (3,) on the way from one to another: 0 is the first, 1 the second."""
    turn = exp_so3(share * log_so3(second[0] @ first[0].T)) @ first[0]
    centres = [camera_centre(*pose) for pose in (first, second)]
    centre = (1 - share) * centres[0] + share * centres[1]
    return turn, -turn @ centre
