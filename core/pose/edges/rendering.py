"""The scan as the camera sees it from a pose: distance, normals, colours."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import AnyArray, ArrayLike, BoolArray, FloatArray, IndexArray
from ...cameras.base import Camera
from ...geometry.meshes import barycentric, face_normals, vertex_normals
from ...geometry.rays import RayCaster
from ..points.smoothing import averaged_normals

SMOOTH = np.radians(3.0)
"""Largest noise of a scan whose normals are taken as they are."""

ROUGH = np.radians(10.0)
"""Noise at which a scan's edges are doubted as much as can be, and creases have to be twice as sharp."""

ROWS = 64
"""Image rows that are cast at once."""


@dataclass(frozen=True, eq=False)
class EdgeScan:
    """A mesh made ready for rendering: vertices (V,3) m, faces (F,3), colours (V,C) of 0 to 255 or None.

    `normals`: unit normals at the corners of the faces (F,3,3), averaged over neighbours, where the scan is
    noisy, else one per face (F,1,3). `noise`: median angle (rad) between a face and its vertices' normals.
    `origin` (3,) m: what has to be added to the vertices.
    """

    vertices: FloatArray
    faces: IndexArray
    normals: FloatArray
    colors: FloatArray | None
    caster: RayCaster
    noise: float
    origin: FloatArray

    @property
    def noisy(self) -> bool:
        """Whether single faces are too noisy to make creases."""
        return bool(self.noise > SMOOTH)

    @classmethod
    def centred(cls, vertices: ArrayLike, faces: ArrayLike, colors: ArrayLike | None = None) -> EdgeScan:
        """Prepare a mesh relative to its middle, `origin`: world coordinates may be millions of metres."""
        points = np.asarray(vertices, dtype=np.float64)
        origin = points.mean(axis=0) if len(points) else np.zeros(3)
        return replace(cls.of_mesh(points - origin, faces, colors), origin=origin)

    @classmethod
    def of_mesh(cls, vertices: FloatArray, faces: ArrayLike, colors: ArrayLike | None = None) -> EdgeScan:
        """Prepare vertices (V,3) m, faces (F,3) and colours (V,), (V,3) or (V,4), bytes or 0 to 1."""
        triangles = np.asarray(faces, dtype=np.int64)
        flat, area = face_normals(vertices, triangles)
        normals = vertex_normals(vertices, triangles)
        cosine = np.einsum("fk,fk->f", flat, normals[triangles[:, 0]])[area > 0]
        noise = float(np.median(np.arccos(np.clip(cosine, -1, 1)))) if len(cosine) else 0.0
        # noise of single faces makes no crease; the creases of a clean scan stay where its faces meet
        smooth = noise <= SMOOTH
        corner_normals = (
            flat[:, None] if smooth else averaged_normals(normals, triangles, rounds=3)[triangles]
        )
        values = None if colors is None else _color_values(np.asarray(colors), len(vertices))
        caster = RayCaster(vertices, triangles)
        return cls(vertices, triangles, corner_normals, values, caster, noise, np.zeros(3))


def _color_values(colors: AnyArray, count: int) -> FloatArray:
    values: FloatArray = colors.reshape(count, -1)[:, :3].astype(np.float64)
    return values if np.issubdtype(colors.dtype, np.integer) else values * 255.0


@dataclass(frozen=True, eq=False)
class Rendering:
    """What a camera sees: `hit` (H,W), `distance` (H,W) m from the camera centre, 0 where nothing is hit.

    `normals` (H,W,3) unit, camera frame, towards the camera; `colors` (H,W,C) or None; zero without a hit.
    """

    hit: BoolArray
    distance: FloatArray
    normals: FloatArray
    colors: FloatArray | None


def render_scan(camera: Camera, rotation: FloatArray, centre: FloatArray, scan: EdgeScan) -> Rendering:
    """Cast one ray per pixel of `camera`, whatever its model, from a pose (3,3), (3,) m."""
    parts = []
    columns = np.arange(camera.width, dtype=np.float64)
    for top in range(0, camera.height, ROWS):
        rows = np.arange(top, min(top + ROWS, camera.height), dtype=np.float64)
        pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
        parts.append(_cast(camera.unproject(pixels), rotation, centre, scan))
    shape = camera.height, camera.width
    hit, distance, normals, colors = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Rendering(
        hit.astype(bool).reshape(shape),
        distance.reshape(shape),
        normals.reshape(*shape, 3),
        None if scan.colors is None else colors.reshape(*shape, -1),
    )


def _cast(
    rays: FloatArray, rotation: FloatArray, centre: FloatArray, scan: EdgeScan
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Hit, distance, camera-frame normal and colour of rays (N,3)."""
    directions = rays @ rotation
    hits = scan.caster.first_hit(centre, directions)
    struck = np.flatnonzero(hits.face >= 0)
    distance = np.zeros(len(rays))
    distance[struck] = hits.distance[struck]
    normals = np.zeros((len(rays), 3))
    colors = np.zeros((len(rays), 0 if scan.colors is None else scan.colors.shape[1]))
    if len(struck):
        corners = scan.faces[hits.face[struck]]
        normal = scan.normals[hits.face[struck], 0]
        if scan.normals.shape[1] > 1 or scan.colors is not None:
            points = centre + distance[struck, None] * directions[struck]
            share = barycentric(points, scan.vertices[corners])
        if scan.normals.shape[1] > 1:
            normal = np.einsum("nc,nck->nk", share, scan.normals[hits.face[struck]])
            normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        away = np.einsum("nk,nk->n", normal, directions[struck]) > 0
        normals[struck] = np.where(away[:, None], -normal, normal) @ rotation.T
        if scan.colors is not None:
            colors[struck] = np.einsum("nc,nck->nk", share, scan.colors[corners])
    return (hits.face >= 0).astype(np.float64), distance, normals, colors
