"""A painted chapel with a known truth: mesh, and photos taken by casting rays at it.

The paint is a function of place, as fine as the usual photo resolves: what is finer no texture could show as
another photo does, and the figures would tell of the paint. Photos have several focal lengths, lens
distortion, exposure, noise, and a few are out of focus.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from fresco.core.arrays import BoolArray, ByteArray, FloatArray, IntArray
from fresco.core.cameras import PerspectiveCamera
from fresco.core.geometry.rays import RayCaster
from fresco.core.photos import View

Mesh = tuple[FloatArray, IntArray]
Patch = Callable[[FloatArray, FloatArray], FloatArray]

_TILE = 4096
_METRES = 6.0
"""Side of the painted tile that repeats over the surfaces."""
_FINEST = 0.0035
"""Blur of the paint (sigma, m); a pixel covers 7 mm in the median."""


def chapel_mesh(cell: float = 0.067, roughness: float = 0.0008) -> Mesh:
    """A nave of 12 x 8 m with barrel vault, six pillars, an altar and steps; faces look into the room."""
    parts = [
        _sheet(lambda u, v: np.stack([12 * u, 8 * v, 0 * u], -1), 12, 8, cell),
        _sheet(lambda u, v: np.stack([12 * u, 0 * u, 4 * v], -1), 12, 4, cell, flip=True),
        _sheet(lambda u, v: np.stack([12 * u, 8 + 0 * u, 4 * v], -1), 12, 4, cell),
        _sheet(_end_wall(0.0), 8, 5.5, cell),
        _sheet(_end_wall(12.0), 8, 5.5, cell, flip=True),
        _sheet(_vault, 12, 10, cell, flip=True),
        *(_pillar(x, y, cell) for x in (3.0, 6.0, 9.0) for y in (2.0, 6.0)),
        *_box((10.2, 3.0, 0.0), (11.2, 5.0, 1.1), cell),
        *_box((9.6, 2.4, 0.0), (11.9, 5.6, 0.2), cell),
    ]
    vertices = np.concatenate([part[0] for part in parts])
    starts = np.cumsum([0] + [len(part[0]) for part in parts[:-1]])
    faces = np.concatenate([part[1] + start for part, start in zip(parts, starts, strict=True)])
    vertices += np.random.default_rng(5).normal(scale=roughness, size=vertices.shape)
    return vertices, faces[~_built_over(vertices[faces])].astype(np.int32)


def _built_over(corners: FloatArray) -> BoolArray:
    """Floor that pillars, steps and altar stand on, which no scanner sees: corners (F,3,3) -> (F,)."""
    centre = corners.mean(axis=1)
    flat = np.ptp(corners[..., 2], axis=1) < 0.02

    def below(x: tuple[float, float], y: tuple[float, float], top: float) -> BoolArray:
        level = np.abs(centre[:, 2] - top) < 0.02
        inside = (centre[:, 0] > x[0]) & (centre[:, 0] < x[1]) & (centre[:, 1] > y[0]) & (centre[:, 1] < y[1])
        return flat & level & inside

    built = below((9.6, 11.9), (2.4, 5.6), 0.0) | below((10.2, 11.2), (3.0, 5.0), 0.2)
    for x in (3.0, 6.0, 9.0):
        for y in (2.0, 6.0):
            built |= flat & (centre[:, 2] < 0.01) & (np.hypot(centre[:, 0] - x, centre[:, 1] - y) < 0.36)
    return built


def _sheet(patch: Patch, width: float, height: float, cell: float, flip: bool = False) -> Mesh:
    columns, rows = max(1, round(width / cell)), max(1, round(height / cell))
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    i = np.arange(u.size).reshape(u.shape)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return patch(u.ravel(), v.ravel()), faces[:, ::-1] if flip else faces


def _end_wall(x: float) -> Patch:
    def patch(u: FloatArray, v: FloatArray) -> FloatArray:
        top = 4 + 2.4 * np.sqrt(np.maximum(0, 1 - (2 * u - 1) ** 2))
        return np.stack([x + 0 * u, 8 * u, v * top], -1)

    return patch


def _vault(u: FloatArray, v: FloatArray) -> FloatArray:
    angle = np.pi * v
    return np.stack([12 * u, 4 - 4 * np.cos(angle), 4 + 2.4 * np.sin(angle)], -1)


def _pillar(x: float, y: float, cell: float) -> Mesh:
    def patch(u: FloatArray, v: FloatArray) -> FloatArray:
        radius = 0.32 + 0.08 * (np.exp(-((v / 0.05) ** 2)) + np.exp(-(((1 - v) / 0.05) ** 2)))
        angle = 2 * np.pi * u
        return np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle), 5.6 * v], -1)

    return _sheet(patch, 2.0, 5.6, cell)


def _box(low: tuple[float, float, float], high: tuple[float, float, float], cell: float) -> list[Mesh]:
    (x0, y0, z0), (x1, y1, z1) = low, high
    dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
    return [
        _sheet(lambda u, v: np.stack([x0 + dx * u, y0 + dy * v, z1 + 0 * u], -1), dx, dy, cell),
        _sheet(lambda u, v: np.stack([x0 + 0 * u, y0 + dy * u, z0 + dz * v], -1), dy, dz, cell, flip=True),
        _sheet(lambda u, v: np.stack([x1 + 0 * u, y0 + dy * u, z0 + dz * v], -1), dy, dz, cell),
        _sheet(lambda u, v: np.stack([x0 + dx * u, y0 + 0 * u, z0 + dz * v], -1), dx, dz, cell),
        _sheet(lambda u, v: np.stack([x0 + dx * u, y1 + 0 * u, z0 + dz * v], -1), dx, dz, cell, flip=True),
    ]


def painted_tile() -> ByteArray:
    """The tile (4096,4096,3) that covers the surfaces: plaster, ashlar joints, painted fields, fine print."""
    random = np.random.default_rng(11)
    tile = np.full((_TILE, _TILE, 3), (168, 158, 140), np.float32)
    for octave in range(2, 11):
        size = 2**octave
        noise = random.normal(size=(size, size, 3)).astype(np.float32) * (
            0.4 + 0.6 * random.normal(size=(size, size, 1))
        )
        noise = cv2.copyMakeBorder(noise.astype(np.float32), 0, 1, 0, 1, cv2.BORDER_WRAP)
        tile += (11.0 if octave < 8 else 6.0) * cv2.resize(
            noise, (_TILE, _TILE), interpolation=cv2.INTER_CUBIC
        )
    for row in range(12):  # ashlar
        y = row * _TILE // 12
        cv2.line(tile, (0, y), (_TILE, y), (96, 88, 78), 7)
        for x in range(_TILE // 16 * (row % 2), _TILE, _TILE // 8):
            cv2.line(tile, (x, y), (x, y + _TILE // 12), (96, 88, 78), 7)
    for _ in range(42):  # painted fields and figures
        centre = random.integers(200, _TILE - 200, 2).tolist()
        axes = random.integers(30, 190, 2).tolist()
        colour = random.integers(30, 230, 3).tolist()
        angle = float(random.uniform(0, 180))
        cv2.ellipse(
            tile, centre, axes, angle, 0, 360, colour, -1 if random.random() < 0.6 else 14, cv2.LINE_AA
        )
    for _ in range(160):  # inscriptions
        at = random.integers(50, _TILE - 500, 2).tolist()
        text = "".join(chr(c) for c in random.integers(65, 91, 12))
        cv2.putText(
            tile,
            text,
            at,
            cv2.FONT_HERSHEY_TRIPLEX,
            float(random.uniform(0.8, 3)),
            (46, 38, 40),
            3,
            cv2.LINE_AA,
        )
    sigma = _FINEST * _TILE / _METRES
    padded = cv2.copyMakeBorder(np.clip(tile, 4, 250), 64, 64, 64, 64, cv2.BORDER_WRAP)
    return np.rint(cv2.GaussianBlur(padded, (0, 0), sigma)[64:-64, 64:-64]).astype(np.uint8)


def colours_at(points: FloatArray, normals: FloatArray, tile: ByteArray) -> FloatArray:
    """Linear colours (N,3) of surface points: the tile seen along the dominant axis, with a broad tint."""
    axis = np.argmax(np.abs(normals), axis=1)
    other = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    rows = np.arange(len(points))
    st = np.stack([points[rows, other[:, 0]], points[rows, other[:, 1]]], 1) + axis[:, None] * 1.37
    pixel = np.mod(st / _METRES, 1) * _TILE - 0.5
    rows_padded = -(-len(pixel) // 8192) * 8192
    grid = np.zeros((rows_padded, 2), np.float32)
    grid[: len(pixel)] = pixel
    grid = grid.reshape(-1, 8192, 2)
    value = cv2.remap(tile, grid[..., 0], grid[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    srgb = value.reshape(-1, 3)[: len(pixel)] / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    tint = 1 + 0.25 * np.sin(points @ np.array([[0.5, 0.1, 0.4], [0.2, 0.6, -0.1], [0.3, -0.4, 0.5]]))
    return 0.8 * linear * tint


@dataclass(frozen=True)
class Shot:
    """How one photo is taken: `exposure` linear RGB factors, `blur` sigma in pixels."""

    view: View
    exposure: FloatArray
    blur: float = 0.0


# Chosen once from 1000 random poses: those used see 98 % of the faces together. Every fifth is meant to be
# held out and stands anywhere.
_CHOSEN = [
    *(469, 894, 645, 466, 809, 500, 602, 354, 487, 729, 868, 944, 387, 654, 595),
    *(622, 977, 539, 593, 960, 143, 381, 505, 982, 966, 255, 89, 47, 576, 12),
]
_EXPOSURE = {0: -0.49, 3: 0.35, 6: -0.5, 8: 0.44, 12: 0.3, 15: -0.43, 18: 0.26, 21: -0.45, 25: -0.2, 27: 0.22}
"""Exposure values of the photos that were not exposed alike."""
_BLURRED = (6, 13, 20)


def plan_shots(size: tuple[int, int] = (1500, 1000), pinhole: bool = False) -> list[Shot]:
    """Thirty places in the nave, with their exposures; three are out of focus.

    `pinhole`: lenses without distortion whose axis meets the middle of the frame, for programs that know no
    others.
    """
    poses = random_poses(np.random.default_rng(1), 1000, size)
    shots = []
    for number, chosen in enumerate(_CHOSEN):
        ev = _EXPOSURE.get(number, 0.0)
        exposure = 2.0**ev * np.array([1 + 0.12 * ev, 1.0, 1 - 0.12 * ev])
        view = replace(poses[chosen], name=f"shot{number:02d}")
        if pinhole:
            view = replace(view, camera=_pinhole(view.camera))
        shots.append(Shot(view, exposure, 2.5 if number in _BLURRED else 0.0))
    return shots


def _pinhole(camera: PerspectiveCamera) -> PerspectiveCamera:
    K = np.array(camera.K, dtype=float)
    K[:2, 2] = (camera.width - 1) / 2, (camera.height - 1) / 2
    return PerspectiveCamera(camera.width, camera.height, K)


def random_poses(random: np.random.Generator, count: int, size: tuple[int, int]) -> list[View]:
    """Views from standing height and a ladder, clear of pillars and steps, in every direction."""
    views = []
    width, height = size
    for number in range(count):
        while True:
            centre = random.uniform((0.6, 0.6, 1.2), (11.4, 7.4, 2.6))
            beside = [
                np.hypot(*(centre[:2] - pillar)) > 0.8 for pillar in itertools.product((3, 6, 9), (2, 6))
            ]
            if all(beside) and not (centre[0] > 9.4 and 2.2 < centre[1] < 5.8):
                break
        heading = 2 * np.pi * (number * 0.38196601125)
        pitch = random.uniform(-0.35, 0.75)
        ahead = np.array([np.cos(heading) * np.cos(pitch), np.sin(heading) * np.cos(pitch), np.sin(pitch)])
        right = np.cross(ahead, (0, 0, 1))
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(ahead, right), ahead])
        focal = float(random.choice([0.5, 0.62, 0.72])) * width
        K = [[focal, 0, width / 2 + 6], [0, focal, height / 2 - 9], [0, 0, 1]]
        camera = PerspectiveCamera(width, height, K, (-0.09, 0.03, 0.0004, -0.0003))
        views.append(View(camera, rotation, -rotation @ centre, np.zeros((1, 1, 3), np.uint8)))
    return views


def is_held_out(number: int) -> bool:
    """Whether a shot of `plan_shots` is kept for comparison."""
    return number % 5 == 4


def photograph(shot: Shot, mesh: Mesh, tile: ByteArray, samples: int = 2, noise: float = 1.0) -> ByteArray:
    """Pixels of a shot: `samples` squared rays per pixel, blur in linear light, noise in grey levels."""
    vertices, faces = mesh
    camera, view = shot.view.camera, shot.view
    caster = RayCaster(vertices, faces)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    light = np.zeros((camera.height, camera.width, 3))
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = np.stack([u.ravel(), v.ravel()], 1).astype(float)
    for du in (np.arange(samples) + 0.5) / samples - 0.5:
        for dv in (np.arange(samples) + 0.5) / samples - 0.5:
            rays = camera.unproject(pixels + np.array([du, dv])) @ view.rotation
            hits = caster.first_hit(view.centre, rays)
            seen = hits.face >= 0
            colour = np.zeros((len(pixels), 3))
            points = view.centre + rays[seen] * hits.distance[seen, None]
            colour[seen] = colours_at(points, normals[hits.face[seen]], tile)
            light += colour.reshape(light.shape)
    light *= shot.exposure / samples**2
    if shot.blur:
        light = cv2.GaussianBlur(light, (0, 0), shot.blur)
    light = np.clip(light, 0, 1)
    srgb = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    random = np.random.default_rng(sum(view.name.encode()))
    return np.clip(np.rint(255 * srgb + noise * random.normal(size=srgb.shape)), 0, 255).astype(np.uint8)


def chapel_views(
    folder: Path, mesh: Mesh | None = None, pinhole: bool = False
) -> tuple[list[View], list[View]]:
    """Photos used and held out, as PNG files in `folder`, taken now if they are not there."""
    mesh = mesh or chapel_mesh()
    tile = painted_tile()
    folder.mkdir(parents=True, exist_ok=True)
    used, held = [], []
    for number, shot in enumerate(plan_shots(pinhole=pinhole)):
        path = folder / f"{shot.view.name}.png"
        if not path.exists():
            cv2.imwrite(str(path), photograph(shot, mesh, tile)[..., ::-1])
        (held if is_held_out(number) else used).append(replace(shot.view, image=path))
    return used, held
