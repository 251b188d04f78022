"""Edges of the scan as seen from a pose: silhouettes, depth steps, creases and colour edges, all visible."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import BoolArray, Float32Array, FloatArray, IndexArray
from ...cameras.base import Camera
from ...settings import EdgeSettings
from .photo_edges import structure_tensor
from .rendering import ROUGH, EdgeScan, Rendering, render_scan


@dataclass(frozen=True, eq=False)
class ScanEdges:
    """Edge points: `points` (N,3) m world, on the nearer surface; `pixels` (N,2) where the camera sees them.

    `normals` (N,2) unit, across the edge in the image; `strength` (N,); `piece` (N,): number of the connected
    piece of edge that each belongs to.
    """

    points: FloatArray
    pixels: FloatArray
    normals: FloatArray
    strength: FloatArray
    piece: IndexArray

    def __len__(self) -> int:
        return len(self.points)

    def select(self, chosen: BoolArray | IndexArray) -> ScanEdges:
        """Return the edge points `chosen`."""
        return ScanEdges(
            self.points[chosen],
            self.pixels[chosen],
            self.normals[chosen],
            self.strength[chosen],
            self.piece[chosen],
        )


def find_scan_edges(
    camera: Camera, rotation: FloatArray, centre: FloatArray, scan: EdgeScan, settings: EdgeSettings
) -> ScanEdges:
    """Edges of the scan with sub-pixel position and direction, from a pose (3,3), (3,) m.

    The surface's turn (creases, silhouettes of round bodies), its depth steps and, where the scan has any,
    its colour make one gradient field; edges are its ridges. The scan's own borders and holes are no edges.
    Source: method.md 2.6; non-maximum suppression of Canny 1986.
    """
    seen = render_scan(camera, rotation, centre, scan)
    # noise turns the surface, too
    crease = settings.crease * (1.0 + scan.noise / ROUGH)
    xx, yy, xy = _gradients(camera, seen, crease, settings.step)
    solid = cv2.erode(seen.hit.astype(np.uint8), np.ones((7, 7), np.uint8), borderValue=[1.0])
    magnitude = np.sqrt(xx + yy) * solid
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    row, column, offset, normal = _ridges(magnitude, angle, threshold=1.0)
    pixels = np.stack([column, row], axis=1) + offset[:, None] * normal
    rays = camera.unproject(pixels)
    distance = _nearer(seen)[row, column]
    strength = np.minimum(magnitude[row, column], 3.0)
    usable = np.isfinite(rays).all(axis=1) & (distance > 0)
    points = centre + (rays @ rotation) * distance[:, None]
    piece = _pieces(row, column, normal, magnitude.shape)
    return ScanEdges(points, pixels, normal, strength.astype(np.float64), piece).select(usable)


def _gradients(
    camera: Camera, seen: Rendering, crease: float, step: float
) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Structure tensor of the surface in units of the smallest edge (degrees, px): xx, yy, xy (H,W)."""
    weight = seen.hit.astype(np.float32)
    unit = np.float32(1.0 / np.radians(crease))
    xx, yy, xy = structure_tensor(unit * _smooth(seen.normals[..., k], weight) for k in range(3))
    step_x, step_y = _depth_steps(camera, seen, step)
    xx, yy = xx + step_x**2, yy + step_y**2
    if seen.colors is not None:
        channels = (np.log(seen.colors[..., k] + 4.0) for k in range(seen.colors.shape[2]))
        # a tenth of the brightness per pixel makes an edge
        color = structure_tensor(np.float32(10.0) * _smooth(c, weight) for c in channels)
        xx, yy, xy = xx + color[0], yy + color[1], xy + color[2]
    return xx, yy, xy


def _smooth(channel: FloatArray, weight: Float32Array) -> Float32Array:
    """Gaussian mean (1 px) over the pixels that hit the scan."""
    total = cv2.GaussianBlur(weight, (0, 0), 1.0) + 1e-3
    mean: Float32Array = cv2.GaussianBlur(channel.astype(np.float32) * weight, (0, 0), 1.0) / total
    return mean


def _depth_steps(camera: Camera, seen: Rendering, step: float) -> tuple[Float32Array, Float32Array]:
    """Depth steps between neighbours along x and y, in units of the smallest one, 0 without.

    A step is what lies off the tangent planes of both neighbours, so that a slanted wall has none.
    """
    rows, columns = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = camera.unproject(np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(np.float64))
    points = np.nan_to_num(rays).reshape(*seen.hit.shape, 3) * seen.distance[..., None]
    pixel = float(np.nanmedian(np.linalg.norm(np.diff(rays.reshape(*seen.hit.shape, 3), axis=1), axis=2)))
    steps = []
    for axis in (1, 0):
        apart = np.roll(points, -1, axis) - points
        off = np.minimum(
            np.abs((apart * seen.normals).sum(-1)), np.abs((apart * np.roll(seen.normals, -1, axis)).sum(-1))
        )
        near = np.minimum(seen.distance, np.roll(seen.distance, -1, axis))
        both = seen.hit & np.roll(seen.hit, -1, axis)
        np.moveaxis(both, axis, 0)[-1] = False  # rolled around the frame
        size = np.where(both, off / np.maximum(near * pixel * step, 1e-12), 0.0)
        size = np.where(size > 1.0, np.minimum(size, 3.0), 0.0).astype(np.float32)
        # the step lies between two pixels: give it to both, so that its ridge is there
        shared = 0.5 * (size + np.roll(size, 1, axis))
        steps.append(cv2.GaussianBlur(shared, (0, 0), 1.0) * np.float32(2.5))
    return steps[0], steps[1]


def _ridges(
    magnitude: Float32Array, angle: Float32Array, threshold: float
) -> tuple[IndexArray, IndexArray, FloatArray, FloatArray]:
    """Maxima across their direction: row, column (N,), sub-pixel offset (N,) along the normal (N,2)."""
    rows, columns = np.mgrid[0 : magnitude.shape[0], 0 : magnitude.shape[1]].astype(np.float32)
    cosine, sine = np.cos(angle), np.sin(angle)
    before = cv2.remap(magnitude, columns - cosine, rows - sine, cv2.INTER_LINEAR)
    after = cv2.remap(magnitude, columns + cosine, rows + sine, cv2.INTER_LINEAR)
    row, column = np.nonzero((magnitude > before) & (magnitude >= after) & (magnitude > threshold))
    a, b, c = before[row, column], magnitude[row, column], after[row, column]
    offset = np.clip(0.5 * (a - c) / (a + c - 2 * b), -0.5, 0.5).astype(np.float64)
    normal = np.stack([cosine[row, column], sine[row, column]], axis=1).astype(np.float64)
    return row, column, offset, normal


def _pieces(row: IndexArray, column: IndexArray, normal: FloatArray, shape: tuple[int, ...]) -> IndexArray:
    """Number (N,) of the connected piece of edge of each ridge pixel; a piece ends where the edge turns."""
    double_angle = 2 * np.arctan2(normal[:, 1], normal[:, 0])
    # four directions of 45 degrees; level and upright edges are in the middle of theirs
    direction = np.rint(double_angle / (np.pi / 2)).astype(np.int64) % 4
    piece = np.zeros(len(row), dtype=np.int64)
    count = 0
    for k in range(4):
        here = direction == k
        drawn = np.zeros(shape, np.uint8)
        drawn[row[here], column[here]] = 1
        labels, label = cv2.connectedComponents(drawn, connectivity=8)
        piece[here] = label[row[here], column[here]] + count
        count += labels
    return piece


def _nearer(seen: Rendering) -> FloatArray:
    """Smallest distance within a pixel (H,W): the occluding surface at a depth step."""
    far = np.where(seen.hit, seen.distance, np.inf).astype(np.float32)
    near = cv2.erode(far, np.ones((3, 3), np.uint8))
    # only across a step; elsewhere the pixel's own distance is the better one
    stepped = near < 0.97 * far
    out: FloatArray = np.where(stepped & seen.hit, near, seen.distance).astype(np.float64)
    return out
