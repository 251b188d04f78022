"""A small project on disk: a grid of faces in four labelled quarters, two photos of noise with masks."""

import cv2
import numpy as np
import pytest

WIDTH, HEIGHT = 96, 64

PROJECT = """
fresco = 1

[scan]
path = "felmérés/déli fal.ply"

[regions]
labels = "felmérés/címkék.npz"
key = "label"
names = { ablak = 1, "fülke bal" = 2, "ajtó" = 3 }

[[camera]]
focal = 80.0

[[photo]]
path = "képek/*.png"
regions = "maszkok/{photo}/{region}.png"

[output]
folder = "eredmény mappa"
"""


def write_image(path, pixels):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(cv2.imencode(path.suffix, pixels)[1].tobytes())
    return path


def write_scan(path, vertices, faces):
    path.parent.mkdir(parents=True, exist_ok=True)
    header = f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz")
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [" ".join(map(repr, map(float, xyz))) for xyz in vertices]
    rows += ["3 " + " ".join(map(str, face)) for face in faces]
    path.write_text(header + "\n".join(rows) + "\n")
    return path


def grid_scan(n=9):
    x, y = np.meshgrid(np.arange(n) * 0.5, np.arange(n) * 0.5)
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(n * n)], axis=1)
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + n], 1), np.stack([i + 1, i + n + 1, i + n], 1)])
    middle = vertices[faces].mean(axis=1)
    labels = 1 + (middle[:, 0] > 2).astype(np.int16) + 2 * (middle[:, 1] > 2)
    return vertices, faces, labels


@pytest.fixture
def folder(tmp_path):
    """Return the folder of a complete project whose every path has accents and spaces."""
    folder = tmp_path / "Szent György templom"
    vertices, faces, labels = grid_scan()
    write_scan(folder / "felmérés" / "déli fal.ply", vertices, faces)
    np.savez(folder / "felmérés" / "címkék.npz", label=labels, other=labels)
    rng = np.random.default_rng(0)
    for name in ("kép 1", "kép 2"):
        write_image(
            folder / "képek" / f"{name}.png", rng.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
        )
        for number, region in enumerate(["ablak", "fülke bal"]):
            mask = np.zeros((HEIGHT, WIDTH), np.uint8)
            mask[10:30, 10 + 40 * number : 40 + 40 * number] = 255
            write_image(folder / "maszkok" / name / f"{region}.png", mask)
    (folder / "terv.toml").write_text(PROJECT, encoding="utf-8")
    return folder


CORNER = """
fresco = 1
[scan]
path = "scan.ply"
[regions]
labels = "labels.npy"
names = { tall = 1, wide = 2, small = 3 }
[[camera]]
focal = 390
[[photo]]
path = "photos/*.png"
regions = "masks/{photo}/{region}.png"
[output]
folder = "out"
"""
REGIONS = {  # wall, then from and to along the wall and in height, in cells of 0.2 m
    "tall": (0, (2, 3), (6, 13)),
    "wide": (1, (2, 8), (10, 12)),
    "small": (0, (8, 4), (12, 7)),
}
FOCAL = 390
CELL, LENGTH, TALL = 0.2, 20, 15
SIZE = (480, 360)


def corner_scan():
    """Two walls that meet at x = y = 0, seen from positive x and y: vertices (m), faces, label per face."""
    vertices, faces, labels = [], [], []
    for wall in (0, 1):
        along, up = np.meshgrid(np.arange(LENGTH + 1), np.arange(TALL + 1), indexing="ij")
        flat = np.zeros(along.size)
        xyz = [along.ravel() * CELL, flat, up.ravel() * CELL]
        vertices.append(np.stack(xyz if wall == 0 else [xyz[1], xyz[0], xyz[2]], axis=1))
        i = (np.arange(LENGTH)[:, None] * (TALL + 1) + np.arange(TALL)).ravel()
        a, b, c, d = i, i + TALL + 1, i + TALL + 2, i + 1
        ring = np.concatenate([np.stack([a, c, b], 1), np.stack([a, d, c], 1)])
        ring = ring if wall == 0 else ring[:, ::-1]
        faces.append(ring + wall * len(vertices[0]))
        middle = vertices[-1][ring].mean(axis=1)[:, [wall, 2]] / CELL
        label = np.zeros(len(ring), dtype=np.int16)
        for number, (where, low, high) in enumerate(REGIONS.values(), 1):
            if where == wall:
                label[((middle > low) & (middle < high)).all(axis=1)] = number
        labels.append(label)
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(labels)


def corner_photo(eye, target, speckled=False):
    """Rotation, translation, colours (H,W,3) and region masks of a photo of the corner."""
    forward = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    width, height = SIZE
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    rays = (
        np.stack([(u - (width - 1) / 2) / FOCAL, (v - (height - 1) / 2) / FOCAL, np.ones_like(u)], axis=-1)
        @ rotation
    )
    distance = np.stack(
        [np.where(rays[..., 1 - w] < 0, -eye[1 - w] / rays[..., 1 - w], np.inf) for w in (0, 1)]
    )
    wall = np.argmin(distance, axis=0)
    points = np.asarray(eye) + rays * distance.min(axis=0)[..., None]
    along = np.where(wall == 0, points[..., 0], points[..., 1]) / CELL
    up = points[..., 2] / CELL
    wave = np.sin(0.9 * along + wall)[..., None] * np.cos([0.5 * up, 0.7 * up, 0.9 * up]).transpose(1, 2, 0)
    rgb = np.clip(130 + 90 * wave, 0, 255).astype(np.uint8)
    if speckled:  # detail that features hold on to, the same in every photo
        grain = np.random.default_rng(3).uniform(0.3, 1.0, (2, 400, 320))
        rgb = (rgb * speckle(grain, wall, along / 20, up / 15)[..., None]).astype(np.uint8)
    masks = {
        name: (wall == w) & (along > low[0]) & (along < high[0]) & (up > low[1]) & (up < high[1])
        for name, (w, low, high) in REGIONS.items()
    }
    return rotation, -rotation @ np.asarray(eye), rgb, masks


def speckle(grain, wall, along, up):
    """Bilinear values of a grid per wall at places in 0..1."""
    out = np.zeros(wall.shape)
    for number in (0, 1):
        here = wall == number
        x, y = (np.clip(a[here], 0, 0.999) * (n - 1) for a, n in ((along, 400), (up, 320)))
        i, j = x.astype(int), y.astype(int)
        a, b = x - i, y - j
        g = grain[number]
        low = g[i, j] * (1 - a) + g[i + 1, j] * a
        out[here] = low * (1 - b) + (g[i, j + 1] * (1 - a) + g[i + 1, j + 1] * a) * b
    return out


EYES = {"A": (3.6, 4.4, 1.5), "B": (4.6, 3.4, 1.7), "C": (2.9, 5.0, 1.2)}


@pytest.fixture
def corner(tmp_path):
    """Return a function that writes the corner project, moved by an offset (m), and tells the true poses."""

    def write(offset=(0.0, 0.0, 0.0), folder=tmp_path / "Sarok, mérés 1", speckled=False):
        vertices, faces, labels = corner_scan()
        write_scan(folder / "scan.ply", vertices + np.asarray(offset), faces)
        np.save(folder / "labels.npy", labels)
        truth = {}
        for name, eye in EYES.items():
            rotation, translation, rgb, masks = corner_photo(eye, (0.9, 0.9, 1.5), speckled)
            write_image(folder / "photos" / f"{name}.png", rgb[:, :, ::-1])
            for region, mask in masks.items():
                write_image(folder / "masks" / name / f"{region}.png", mask.astype(np.uint8) * 255)
            truth[name] = rotation, translation - rotation @ np.asarray(offset)
        (folder / "project.toml").write_text(CORNER, encoding="utf-8")
        return folder / "project.toml", truth

    return write
