"""Small scenes with a known truth: surfaces whose colour is a function of place, and photos of them."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from fresco.core.arrays import ByteArray, FloatArray, IntArray
from fresco.core.cameras import Camera, PerspectiveCamera
from fresco.core.geometry.rays import RayCaster
from fresco.core.photos import View
from fresco.core.texture.views.images import sample_image, to_bytes, to_srgb


def grid_mesh(
    columns: int, rows: int, width: float = 4.0, height: float = 3.0
) -> tuple[FloatArray, IntArray]:
    """A wall in the plane z = 0 whose front looks along -z: (V,3), (F,3)."""
    x, y = np.meshgrid(
        np.linspace(-width / 2, width / 2, columns + 1), np.linspace(-height / 2, height / 2, rows + 1)
    )
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    i = np.arange((columns + 1) * (rows + 1)).reshape(rows + 1, columns + 1)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
    faces = np.concatenate([np.stack([a, c, b], 1), np.stack([a, d, c], 1)])
    return vertices, faces.astype(np.int32)


def box_mesh(low: tuple[float, float, float], high: tuple[float, float, float], cells: int = 6):
    """A box seen from outside: (V,3), (F,3)."""
    vertices, faces, count = [], [], 0
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    for axis in range(3):
        for side in (0, 1):
            grid, triangles = grid_mesh(cells, cells, 1.0, 1.0)
            unit = grid[:, :2] + 0.5
            points = np.empty((len(grid), 3))
            points[:, axis] = side
            points[:, (axis + 1) % 3], points[:, (axis + 2) % 3] = unit[:, 0], unit[:, 1]
            vertices.append(low + points * (high - low))
            faces.append((triangles if side == 0 else triangles[:, ::-1]) + count)
            count += len(grid)
    return np.concatenate(vertices), np.concatenate(faces).astype(np.int32)


def join(*meshes):
    """Several meshes as one: (V,3), (F,3)."""
    points = [np.asarray(vertices) for vertices, _ in meshes]
    starts = np.cumsum([0] + [len(p) for p in points[:-1]])
    faces = [np.asarray(f) + start for (_, f), start in zip(meshes, starts, strict=True)]
    return np.concatenate(points), np.concatenate(faces).astype(np.int32)


def look_at(centre, target, up=(0.0, -1.0, 0.0)) -> tuple[FloatArray, FloatArray]:
    """Pose (rotation, translation) of a camera at `centre` that looks at `target`."""
    centre, target = np.asarray(centre, dtype=float), np.asarray(target, dtype=float)
    z = target - centre
    z /= np.linalg.norm(z)
    x = np.cross(-np.asarray(up, dtype=float), z)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z])
    return rotation, -rotation @ centre


def paint(points: FloatArray, roughness: int = 5) -> FloatArray:
    """Linear colours (N,3) in [0.05, 0.75] of world points (N,3): smooth, with detail at several scales."""
    random = np.random.default_rng(7)
    colour = np.zeros((len(points), 3))
    for octave in range(roughness):
        for _ in range(3):
            direction = random.normal(size=(3, 3))
            direction *= 1.5 * 2.0**octave / np.linalg.norm(direction, axis=1, keepdims=True)
            colour += 0.6**octave * np.sin(points @ direction.T + random.uniform(0, 6, 3))
    return 0.4 + 0.35 * np.tanh(0.5 * colour)


@cache
def _plaster() -> np.ndarray:
    """A picture with detail at every scale, 8 m wide."""
    random = np.random.default_rng(9)
    total = np.zeros((1024, 1024, 3), np.float32)
    for octave in range(2, 9):
        noise = random.normal(size=(2**octave, 2**octave, 3)).astype(np.float32)
        total += 0.75**octave * cv2.resize(noise, (1024, 1024), interpolation=cv2.INTER_CUBIC)
    return 0.4 + 0.33 * np.tanh(total)


def detailed(points: FloatArray) -> FloatArray:
    """Linear colours (N,3) of world points with detail down to centimetres; quick."""
    at = np.stack([points[:, 0] + 0.7 * points[:, 2], points[:, 1]], axis=1) * 128.0 + 512.0
    return sample_image(_plaster(), at).astype(float)


def photograph(
    camera: Camera, rotation, translation, mesh, exposure=(1.0, 1.0, 1.0), painter=paint, samples: int = 2
) -> ByteArray:
    """Photo (H,W,3) of a painted mesh, `samples` squared rays per pixel; the background is dark."""
    vertices, faces = mesh
    caster = RayCaster(vertices, faces)
    centre = -np.asarray(rotation).T @ np.asarray(translation)
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    light = np.zeros((len(pixels), 3))
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    for du in offsets:
        for dv in offsets:
            rays = camera.unproject(pixels + np.array([du, dv])) @ np.asarray(rotation)
            hits = caster.first_hit(centre, rays)
            points = centre + rays * hits.distance[:, None]
            seen = hits.face >= 0
            colour = np.full((len(pixels), 3), 0.01)
            colour[seen] = painter(points[seen])
            light += colour * np.asarray(exposure)
    image = to_bytes(to_srgb(light / samples**2))
    return image.reshape(camera.height, camera.width, 3)


def wall_views(
    mesh,
    centres,
    exposures=None,
    focal: float = 300.0,
    size=(320, 240),
    target=(0.0, 0.0, 0.0),
    painter=paint,
):
    """Perspective photos of a mesh from several places, all looking at `target`."""
    width, height = size
    camera = PerspectiveCamera(
        width, height, [[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]]
    )
    views = []
    for number, centre in enumerate(centres):
        rotation, translation = look_at(centre, target)
        exposure = np.broadcast_to(1.0 if exposures is None else exposures[number], (3,))
        image = photograph(camera, rotation, translation, mesh, exposure, painter)
        views.append(View(camera, rotation, translation, image, f"p{number}"))
    return views
