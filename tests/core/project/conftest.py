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
