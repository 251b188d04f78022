"""The sample's geometry: walls in relief, a column, a bench (metres, z up).

A wall is a height field over its own plane: `across` runs along the wall, `up` is z, and the relief stands
out towards the room. Crease lines are constraints of the triangulation, as they would be crisp in stone.
"""

from dataclasses import dataclass, field

import bpy  # noqa: F401  (mathutils comes with it)
import numpy as np
from mathutils.geometry import delaunay_2d_cdt
from scipy.spatial import cKDTree

FRAME = (
    (0.0, -0.006),
    (0.02, 0.016),
    (0.07, 0.016),
    (0.085, 0.0),
)  # (distance outside, relief) of a stucco frame


@dataclass(frozen=True)
class Shape:
    """An upright outline: a rectangle, or one with a round-arched top of radius `half`."""

    centre: float
    bottom: float
    half: float
    top: float
    arched: bool = False

    @property
    def spring(self):
        """Height at which the arch begins."""
        return self.top - self.half if self.arched else self.top

    def outline(self, offset=0.0, spacing=0.03):
        """Closed outline moved outwards by `offset` (m): (N,2), N and the order the same for every offset.

        Points are about `spacing` m apart on the outline itself.
        """
        base = self._corners(0.0, spacing)
        return densified(self._corners(offset, spacing), spacing, base)

    def _corners(self, offset, spacing):
        left, right = self.centre - self.half - offset, self.centre + self.half + offset
        low, high = self.bottom - offset, self.spring + (0.0 if self.arched else offset)
        corners = [(left, high), (left, low), (right, low), (right, high)]
        if self.arched:
            radius = self.half + offset
            angle = np.linspace(0, np.pi, max(8, int(np.pi * self.half / spacing)))[1:-1]
            corners += list(
                zip(self.centre + radius * np.cos(angle), high + radius * np.sin(angle), strict=True)
            )
        return np.array(corners)

    def distance(self, points):
        """Signed distance (m), negative inside: (N,2) -> (N,). Its corners outside are square."""
        across, up = np.abs(points[:, 0] - self.centre), points[:, 1]
        straight = np.maximum(across - self.half, self.bottom - up)
        if not self.arched:
            return np.maximum(straight, up - self.top)
        arch = np.hypot(across, up - self.spring) - self.half
        return np.where(up > self.spring, np.maximum(arch, self.bottom - up), straight)


@dataclass(frozen=True)
class Feature:
    """Relief that follows a shape: (signed distance, height) knots, and the curved depth of a niche."""

    shape: Shape
    knots: tuple = FRAME
    niche_depth: float = 0.0
    hole_below: float | None = None

    def relief(self, points):
        """Height towards the room (m), NaN where the wall goes on undisturbed: (N,2) -> (N,)."""
        distance = self.shape.distance(points)
        at, height = np.array(self.knots).T
        relief = np.interp(distance, at, height)
        if self.niche_depth:
            relief = np.where(distance < 0, relief - self._hollow(points), relief)
        relief[distance > at[-1]] = np.nan
        return relief

    def _hollow(self, points):
        shape = self.shape
        across = (points[:, 0] - shape.centre) / shape.half
        above = np.maximum(points[:, 1] - shape.spring, 0) / shape.half
        sill = np.clip((points[:, 1] - shape.bottom) / 0.3, 0, 1)
        return self.niche_depth * np.clip(1 - across**2 - above**2, 0, 1) * sill * (2 - sill)


@dataclass(frozen=True)
class Wall:
    """A wall of `length` x `height` (m) with features and a horizontal profile of (up, relief) knots."""

    length: float
    height: float
    profile: tuple
    features: dict = field(default_factory=dict)

    def relief(self, points):
        """Height of the wall towards the room (m): (N,2) -> (N,)."""
        at, height = np.array(self.profile).T
        relief = np.interp(points[:, 1], at, height)
        for feature in self.features.values():
            own = feature.relief(points)
            relief = np.where(np.isnan(own), relief, own)
        return relief

    def mesh(self, rng, fine, coarse):
        """Triangulate: (V,2) points of the plane, (F,3); `fine` and `coarse` are edge lengths (m)."""
        lines = self._creases(fine)
        lines.append(
            densified(
                np.array([(0, 0), (self.length, 0), (self.length, self.height), (0, self.height)]), fine
            )
        )
        inner = self._inner_points(rng, fine, coarse, np.concatenate(lines))
        points, edges = list(inner), []
        for line in lines:
            start = len(points)
            points += list(line)
            edges += [(start + i, start + (i + 1) % len(line)) for i in range(len(line))]
        for at, _ in self.profile[1:-1]:
            row = np.arange(0, self.length + fine / 2, fine)
            start = len(points)
            points += [(min(x, self.length), at) for x in row]
            edges += [(start + i, start + i + 1) for i in range(len(row) - 1)]
        found = delaunay_2d_cdt([tuple(map(float, p)) for p in points], edges, [], 0, 1e-6)
        plane, faces = np.array([tuple(v) for v in found[0]]), np.array(found[2])
        for feature in self.features.values():
            if feature.hole_below is not None:
                middle = plane[faces].mean(axis=1)
                faces = faces[feature.shape.distance(middle) > feature.hole_below]
        return compact(plane, faces)

    def _creases(self, spacing):
        lines = []
        for feature in self.features.values():
            offsets = [at for at, _ in feature.knots]
            lines += [feature.shape.outline(offset, spacing) for offset in offsets]
            if feature.shape.bottom <= 0:  # a door: its outline ends at the floor
                lines[-len(offsets) :] = [line[line[:, 1] >= 0] for line in lines[-len(offsets) :]]
        return lines

    def _inner_points(self, rng, fine, coarse, creases):
        grids = []
        for spacing, wanted in ((fine, True), (coarse, False)):
            x, z = np.meshgrid(
                np.arange(spacing, self.length, spacing), np.arange(spacing, self.height, spacing)
            )
            x[::2] += spacing / 2
            points = np.stack([x.ravel(), z.ravel()], axis=1) + rng.normal(0, 0.12 * spacing, (x.size, 2))
            grids.append(points[self._detailed(points) == wanted])
        points = np.concatenate(grids)
        inside = ((points > 0.3 * fine) & (points < (self.length, self.height) - np.full(2, 0.3 * fine))).all(
            axis=1
        )
        free = cKDTree(creases).query(points)[0] > 0.45 * fine
        clear = np.min(np.abs(points[:, 1:] - np.array([at for at, _ in self.profile])), axis=1) > 0.35 * fine
        return points[inside & free & clear]

    def _detailed(self, points):
        near = np.zeros(len(points), dtype=bool)
        for feature in self.features.values():
            near |= feature.shape.distance(points) < feature.knots[-1][0] + 0.04
        return near


def densified(corners, spacing, lengths_of=None):
    """Closed polygon with points added until no side of `lengths_of` exceeds `spacing`: (N,2) -> (M,2)."""
    measured = corners if lengths_of is None else lengths_of
    sides = np.linalg.norm(np.roll(measured, -1, axis=0) - measured, axis=1)
    out = []
    for a, b, length in zip(corners, np.roll(corners, -1, axis=0), sides, strict=True):
        count = max(1, int(np.ceil(length / spacing - 1e-9)))
        out += [a + (b - a) * i / count for i in range(count)]
    return np.array(out)


def compact(vertices, faces):
    """Drop vertices that no face uses."""
    used, faces = np.unique(faces, return_inverse=True)
    return vertices[used], faces.reshape(-1, 3)


def grid_faces(rows, columns):
    """Two triangles per cell of a rows x columns grid of vertices."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (
        index[:-1, :-1].ravel(),
        index[:-1, 1:].ravel(),
        index[1:, 1:].ravel(),
        index[1:, :-1].ravel(),
    )
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def revolved(profile, centre, steps):
    """Surface of revolution about the vertical through `centre`: (radius, z) (N,2) -> (V,3), uv, faces."""
    profile = np.asarray(profile)
    angle = np.linspace(0, 2 * np.pi, steps + 1)
    radius, height = profile[:, :1], profile[:, 1:]
    x, y = centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)
    z = np.broadcast_to(height, x.shape)
    uv = np.stack(np.broadcast_arrays(angle / (2 * np.pi), (height - height.min()) / np.ptp(height)), axis=-1)
    faces = grid_faces(len(profile), steps + 1)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3), uv.reshape(-1, 2), faces


def box(low, high, spacing):
    """The five visible sides of a box on the floor: (V,3), uv (metres / 2 along the sides), faces."""
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    sides = []
    for axis, at in ((0, low[0]), (0, high[0]), (1, low[1]), (1, high[1]), (2, high[2])):
        a, b = [i for i in range(3) if i != axis]
        counts = [max(2, int((high[i] - low[i]) / spacing) + 1) for i in (a, b)]
        s, t = np.meshgrid(np.linspace(low[a], high[a], counts[0]), np.linspace(low[b], high[b], counts[1]))
        points = np.zeros((s.size, 3))
        points[:, axis], points[:, a], points[:, b] = at, s.ravel(), t.ravel()
        faces = grid_faces(counts[1], counts[0])
        outward = np.zeros(3)
        outward[axis] = 1 if at == high[axis] else -1
        normal = np.cross(
            points[faces[0, 1]] - points[faces[0, 0]], points[faces[0, 2]] - points[faces[0, 0]]
        )
        sides.append(
            (
                points,
                np.stack([s.ravel() / 2, t.ravel() / 2], 1),
                faces if normal @ outward > 0 else faces[:, ::-1],
            )
        )
    return joined(sides)


def joined(parts):
    """Join (vertices, uv, faces) parts into one."""
    starts = np.cumsum([0] + [len(p[0]) for p in parts[:-1]])
    faces = [p[2] + start for p, start in zip(parts, starts, strict=True)]
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts]), np.concatenate(faces)
