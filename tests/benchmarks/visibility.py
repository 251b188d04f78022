"""How well visibility is told, against exhaustive rays: `python tests/benchmarks/visibility.py`.

The painted chapel (216 000 faces, six pillars) from eight places. For the mesh, a face counts as seen when
90 % of 60 random points on it are free; what lies within 10 % of that limit may fall on either side. For
clouds of some 200 000 points each point is tested by one ray.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from fresco.core.photos import View
from fresco.core.settings import TextureSettings
from fresco.core.texture.surface import Surface
from fresco.core.texture.views.cloud import visible_points
from fresco.core.texture.views.splats import Splats, measure_splats
from fresco.core.texture.views.visibility import project, visible_faces

sys.path.insert(0, str(Path(__file__).parent))
from texture_chapel import chapel_mesh, random_poses

SIZE = (1500, 1000)
POLES = [(2.0, 3.5, 0.05), (5.0, 4.5, 0.1), (7.5, 3.0, 0.08)]
"""Places and widths (m) of scaffold poles that hide the chapel without belonging to it."""


def main() -> None:
    mesh = chapel_mesh()
    views = random_poses(np.random.default_rng(2), 8, SIZE)
    print("| what | method | precision | recall | CPU s per photo |\n|---|---|---|---|---|")
    for name, occluders in (("mesh", []), ("mesh behind a scaffold", [_pole(*pole) for pole in POLES])):
        surface = Surface.from_mesh(*mesh, occluders)
        row(name, "rays", [of_mesh(surface, view) for view in views])
    surface = Surface.from_mesh(*mesh)
    for name, (points, normals) in clouds(surface).items():
        start = time.process_time()
        splats = measure_splats(points, normals)
        share = (time.process_time() - start) / len(views)
        found = [of_cloud(surface, points, normals, view, "depth", 3.0, splats) for view in views]
        found = [(*counts, seconds + share) for *counts, seconds in found]
        row(f"cloud, {name}", "depth buffer of splats, with normals", found)
    points, normals = clouds(surface)["even"]
    for gamma in (2.0, 3.0):
        found = [of_cloud(surface, points, normals, view, "hull", gamma, None) for view in views]
        row("cloud, even", f"hidden point removal, radius 10^{gamma:g}, with normals", found)


def clouds(surface: Surface) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Points and normals: the faces' centroids; places at random; as dense as a scanner's in the middle."""
    normals = surface.normal.astype(np.float64)
    centroid = surface.centroid.astype(np.float64) + surface.origin
    towards = np.array([4.5, 4.0, 1.7]) - centroid
    distance = np.linalg.norm(towards, axis=1)
    cosine = np.abs(np.einsum("nk,nk->n", towards, normals)) / distance
    scanned = np.clip(cosine / distance**2, 0.01, 0.3)  # other stations see what this one does not
    return {
        "even": (centroid, normals),
        "random": _sampled(surface, surface.area),
        "scanned": _sampled(surface, surface.area * scanned),
    }


def _sampled(surface: Surface, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(4)
    face = random.choice(surface.face_count, 200_000, p=weight / weight.sum())
    corners = surface.vertices[surface.faces[face]]
    points = np.einsum("nk,nkc->nc", random.dirichlet((1, 1, 1), len(face)), corners)
    return points + surface.origin, surface.normal[face].astype(np.float64)


def row(what: str, method: str, found: list[tuple[int, int, int, int, float]]) -> None:
    told, wrong, there, missed, seconds = np.sum(found, axis=0)
    precision, recall = 1 - wrong / told, 1 - missed / there
    print(f"| {what} | {method} | {precision:.4f} | {recall:.4f} | {seconds / len(found):.2f} |", flush=True)


def of_mesh(surface: Surface, view: View) -> tuple[int, int, int, int, float]:
    """Faces told as seen, wrong ones of these, faces truly seen, missed ones of these, CPU seconds."""
    start = time.process_time()
    seen = visible_faces(surface, view, TextureSettings(visible_share=0.9))
    seconds = time.process_time() - start
    told = np.zeros(surface.face_count, dtype=np.bool_)
    told[seen.face] = True
    candidates = np.flatnonzero(_in_question(surface, view))
    corners = surface.vertices[surface.faces[candidates]]
    weights = np.random.default_rng(3).dirichlet((1, 1, 1), 60)
    points = np.einsum("sk,fkc->fsc", weights, corners).reshape(-1, 3)
    free = ~surface.caster.occluded(view.centre - surface.origin, points).reshape(-1, 60)
    share = np.zeros(surface.face_count)
    share[candidates] = free.mean(axis=1)
    wrong, missed = told & (share < 0.8), ~told & (share >= 0.97)
    return int(told.sum()), int(wrong.sum()), int((share >= 0.97).sum()), int(missed.sum()), seconds


def of_cloud(
    surface: Surface,
    points: np.ndarray,
    normals: np.ndarray,
    view: View,
    method: str,
    gamma: float,
    splats: Splats | None,
) -> tuple[int, int, int, int, float]:
    """Points told as seen, wrong ones, points truly seen, missed ones, CPU seconds."""
    start = time.process_time()
    told = visible_points(points, normals, view, method, gamma, splats)
    seconds = time.process_time() - start
    truth = view.camera.in_frame(project(view, points))
    truth &= np.einsum("nk,nk->n", view.centre - points, normals) > 0
    truth[truth] = ~surface.caster.occluded(view.centre - surface.origin, points[truth] - surface.origin)
    return int(told.sum()), int((told & ~truth).sum()), int(truth.sum()), int((truth & ~told).sum()), seconds


def _in_question(surface: Surface, view: View) -> np.ndarray:
    """Faces whole in the frame that look at the camera within the largest angle."""
    pixels = project(view, surface.vertices + surface.origin)
    framed = view.camera.in_frame(pixels)[surface.faces].all(axis=1)
    towards = view.centre - surface.origin - surface.centroid
    cosine = np.einsum("nk,nk->n", towards, surface.normal) / np.linalg.norm(towards, axis=1)
    return framed & (cosine > np.cos(np.radians(TextureSettings().max_angle)))


def _pole(x: float, y: float, width: float) -> tuple[np.ndarray, np.ndarray]:
    corner = np.array([(dx, dy, z) for dx in (-1, 1) for dy in (-1, 1) for z in (0.0, 6.4)])
    vertices = np.stack(
        [x + 0.5 * width * corner[:, 0], y + 0.5 * width * corner[:, 1], corner[:, 2]], axis=1
    )
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6)]
    return vertices, np.array(faces, dtype=np.int32)


if __name__ == "__main__":
    main()
