"""Starting poses without hints: affine normalisation, angles from moments, both tilts, both sides."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray
from ...geometry.charts import Chart
from ...geometry.moments import boundary_gram, edge_moments, rotated_moments
from .algebraic import Candidates
from .moment_pair import ORDER, SMOOTHNESS, Edges

ANGLES = np.radians(np.arange(0.0, 360.0, 4.0))
MOST_ANGLES = 6  # minima kept per side


def starting_poses(chart: Chart, outline: Edges, surface: Edges) -> Candidates:
    """Candidates for one region of the photo (edges in its chart) and one surface region (edges in metres).

    The surface region is laid on its mean plane and both shapes are normalised affinely; the remaining turn
    is read from their moments up to order 4, for either side of the surface; the affine map gives two tilts.
    Costs are left at zero. Source: method.md 2.4; weak perspective.
    """
    image_map, image_normal = normalised_shape(outline)
    centre, frames, plane = _plane_frames(surface)
    whitening = np.linalg.inv(np.linalg.cholesky(boundary_gram(*image_normal, ORDER, SMOOTHNESS)))
    target = edge_moments(*image_normal, ORDER)
    rotations, translations = [], []
    for frame, mirrored in zip(frames, (plane * (1, 1), plane * (1, -1)), strict=True):
        edges = (mirrored[0], mirrored[1])
        if _area(edges) < 0:
            edges = (edges[1], edges[0])
        surface_map, surface_normal = normalised_shape(edges)
        for angle in matching_turns(edge_moments(*surface_normal, ORDER), target, whitening):
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            affine = np.linalg.inv(image_map[0]) @ turn @ surface_map[0]
            shift = image_map[1] - affine @ surface_map[1]
            for rotation, translation in _tilted(affine, shift, chart):
                rotations.append(rotation @ frame)
                translations.append(translation - rotations[-1] @ centre)
    return Candidates(np.array(rotations), np.array(translations), np.zeros(len(rotations)))


def _area(edges: Edges) -> float:
    a, b = edges
    return 0.5 * float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))


def normalised_shape(edges: Edges) -> tuple[tuple[FloatArray, FloatArray], Edges]:
    """Map `N (x - mean)` to zero mean and unit second moments, as (N, mean), and the mapped edges."""
    area, mx, my, xx, xy, yy = edge_moments(*edges, 2)
    mean = np.array([mx, my]) / area
    second = np.array([[xx, xy], [xy, yy]]) / area - np.outer(mean, mean)
    values, vectors = np.linalg.eigh(second)
    matrix = vectors @ np.diag(1 / np.sqrt(values)) @ vectors.T
    a, b = ((points - mean) @ matrix.T for points in edges)
    return (matrix, mean), (a, b)


def _plane_frames(surface: Edges) -> tuple[FloatArray, list[FloatArray], FloatArray]:
    """Centre, the two camera-like frames (front, back), and the edges (2,E,2) in the front frame's x and y.

    Rows of a frame are its axes in the world; z looks into the surface. The plane's normal is the area
    vector, which suits curved patches too.
    """
    a, b = surface
    origin = a.mean(axis=0)
    normal = np.cross(a - origin, b - origin).sum(axis=0)
    normal /= np.linalg.norm(normal)
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    x = np.cross(helper, normal)
    x /= np.linalg.norm(x)
    front = np.stack([x, np.cross(-normal, x), -normal])
    back = np.stack([x, np.cross(normal, x), normal])
    plane = np.stack([(a - origin) @ front[:2].T, (b - origin) @ front[:2].T])
    return origin, [front, back], plane


def matching_turns(moments: FloatArray, target: FloatArray, whitening: FloatArray) -> FloatArray:
    """Turns (rad) at which the whitened moment difference has its lowest local minima."""
    residual = (rotated_moments(moments, ANGLES, ORDER) - target) @ whitening.T
    cost = np.sum(residual * residual, axis=1)
    minimal = np.flatnonzero((cost <= np.roll(cost, 1)) & (cost < np.roll(cost, -1)))
    if len(minimal) == 0:
        minimal = np.array([int(np.argmin(cost))])
    lowest: FloatArray = ANGLES[minimal[np.argsort(cost[minimal])][:MOST_ANGLES]]
    return lowest


def _tilted(affine: FloatArray, shift: FloatArray, chart: Chart) -> list[tuple[FloatArray, FloatArray]]:
    """Both poses whose weak-perspective image is `affine @ p + shift` in the chart: frame -> camera."""
    u, values, vt = np.linalg.svd(affine)
    if np.linalg.det(u) < 0:
        u, vt = u @ np.diag([1.0, -1.0]), np.diag([1.0, -1.0]) @ vt
    tilt = np.arccos(min(values[1] / values[0], 1.0))
    depth = chart.scale / values[0]
    plane_point = shift / chart.scale + chart.offset
    direction = chart.rotation.T @ np.array([*plane_point, 1.0])
    poses = []
    for angle in (tilt, -tilt) if tilt > 1e-3 else (0.0,):
        c, s = np.cos(angle), np.sin(angle)
        lift = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        turn = _block(u) @ lift @ _block(vt)
        poses.append((chart.rotation.T @ turn, depth * direction))
    return poses


def _block(matrix: FloatArray) -> FloatArray:
    """2x2 rotation as a rotation about z."""
    out = np.eye(3)
    out[:2, :2] = matrix
    return out
