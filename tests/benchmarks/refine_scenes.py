"""Rendered scenes with known poses for the benchmark of pose refinement: façade, room, wall in relief."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from fresco.core.cameras import PerspectiveCamera

ROOT = Path(__file__).resolve().parents[2]

CAMERA = PerspectiveCamera(1080, 810, [[960, 0, 539.5], [0, 960, 404.5], [0, 0, 1]])


def relief_wall():
    """The wall of the unit tests."""
    path = ROOT / "tests" / "core" / "pose" / "conftest.py"
    spec = importlib.util.spec_from_file_location("relief_wall", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["relief_wall"] = module
    spec.loader.exec_module(module)
    return module.build_wall()


def facade():
    """A façade 7 m wide: pilasters, unequal windows in their reveals, a door, cornices, a gable."""
    step = 0.02
    x, z = np.meshgrid(np.arange(-3.6, 3.6001, step), np.arange(-2.6, 2.6001, step))
    out = 0.08 * (z > 1.25) + 0.2 * (np.abs(z - 1.25) < 0.09) + 0.3 * (z < -2.2)
    for at in (-3.2, -1.05, 1.1, 3.2):
        out = np.maximum(out, 0.18 * (np.abs(x - at) < 0.2) * (z < 1.2))
    windows = (
        (-2.6, -1.0, -1.7, 0.5),
        (-0.55, -2.0, 0.5, -0.05),
        (1.7, -0.9, 2.7, 0.6),
        (-0.4, 0.3, 0.35, 0.95),
    )
    for left, low, right, top in windows:
        frame = (x > left - 0.1) & (x < right + 0.1) & (z > low - 0.12) & (z < top + 0.1)
        out = np.where(frame, np.maximum(out, 0.07), out)
        out = np.where((x > left) & (x < right) & (z > low) & (z < top), -0.28, out)
    out = np.where((z > 1.5) & (np.abs(x) < 2.2 * (2.45 - z)), 0.22, out)
    return heightfield(x, z, out, seed=11)


def heightfield(x, z, out, seed):
    """Mesh of a wall in the plane y = 0 whose surface stands out by `out` (m) towards -y."""
    vertices = np.stack([x, -out, z], axis=-1).reshape(-1, 3)
    rows, columns = x.shape
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([corner, corner + 1, corner + columns + 1], axis=1)
    upper = np.stack([corner, corner + columns + 1, corner + columns], axis=1)
    faces = np.concatenate([lower, upper]).astype(np.int32)
    return replace(relief_wall(), vertices=vertices, faces=faces, seed=seed)


def room():
    """The inside of a room 6 x 7 x 3.5 m with beams, pillars, a chest and a recess, seen towards +y."""
    boxes = [
        ((-3, -3, -1.8), (3, 4, -1.7)),
        ((-3, -3, 1.7), (3, 4, 1.8)),
        ((-3.1, -3, -1.8), (-3, 4, 1.8)),
        ((3, -3, -1.8), (3.1, 4, 1.8)),
        ((-3, 4, -1.8), (-0.9, 4.1, 1.8)),
        ((0.5, 4, -1.8), (3, 4.1, 1.8)),
        ((-0.9, 4, 0.9), (0.5, 4.1, 1.8)),
        ((-1.0, 4.6, -1.8), (0.6, 4.7, 1.0)),
        ((-3, 0.4, 1.45), (3, 0.65, 1.7)),
        ((-3, 2.6, 1.45), (3, 2.85, 1.7)),
        ((-2.2, 2.0, -1.8), (-1.85, 2.35, 1.8)),
        ((1.7, 3.0, -1.8), (2.1, 3.4, 1.8)),
        ((-0.2, 2.7, -1.8), (1.1, 3.3, -1.05)),
        ((-3, 2.4, -0.6), (-2.6, 3.8, -0.5)),
        ((2.75, 0.2, -1.8), (3, 1.6, 0.5)),
    ]
    parts = [box_mesh(np.array(low, float), np.array(high, float)) for low, high in boxes]
    starts = np.cumsum([0] + [len(p[0]) for p in parts[:-1]])
    vertices = np.concatenate([p[0] for p in parts])
    faces = np.concatenate([p[1] + s for p, s in zip(parts, starts, strict=True)]).astype(np.int32)
    return replace(relief_wall(), vertices=vertices, faces=faces, seed=23)


def box_mesh(low, high, step=0.05):
    """Six finely divided sides of a box."""
    parts, faces, start = [], [], 0
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        count = [max(2, int(np.ceil((high[k] - low[k]) / step)) + 1) for k in (u, v)]
        grid = np.meshgrid(*(np.linspace(low[k], high[k], n) for k, n in zip((u, v), count, strict=True)))
        corner = (np.arange(count[1] - 1)[:, None] * count[0] + np.arange(count[0] - 1)).ravel()
        square = np.stack([corner, corner + 1, corner + count[0] + 1, corner + count[0]], axis=1)
        for side in (low[axis], high[axis]):
            points = np.empty((grid[0].size, 3))
            points[:, axis], points[:, u], points[:, v] = side, grid[0].ravel(), grid[1].ravel()
            parts.append(points)
            faces.append(np.concatenate([square[:, :3], square[:, [0, 2, 3]]]) + start)
            start += len(points)
    return np.concatenate(parts), np.concatenate(faces)


def scene_views():
    """Scenes by name, each with its mesh and views (see `ReliefWall`)."""
    wall, front, inside = relief_wall(), facade(), room()
    return {
        "wall": (wall, [wall.view(c, camera=CAMERA) for c in ((0.8, -5.0, 0.4), (-1.5, -4.6, -0.3))]),
        "façade": (
            front,
            [
                front.view(c - front.offset, t - front.offset, camera=CAMERA, texture=0.6)
                for c, t in (((-1.6, -6.6, -0.9), (0.2, 0, 0.0)), ((2.2, -6.0, -0.6), (0.3, 0, 0.1)))
            ],
        ),
        "room": (
            inside,
            [
                inside.view(
                    c - inside.offset, t - inside.offset, camera=CAMERA, light=light, texture=0.4, fill=0.8
                )
                for c, t, light in (
                    ((0.8, -2.6, 0.2), (-0.3, 3, -0.1), (0.5, -0.6, 0.4)),
                    ((-1.2, -2.4, -0.2), (0.5, 3, 0.1), (-0.4, -0.7, 0.3)),
                )
            ],
        ),
    }
