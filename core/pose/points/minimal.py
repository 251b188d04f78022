"""A camera's pose from three points: every solution, for rays in any direction, many triples at once."""

from __future__ import annotations

import numpy as np

from ...arrays import BoolArray, FloatArray


def solve_p3p(rays: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Poses that put three points on three viewing rays.

    rays (B,3,3) unit, camera frame; points (B,3,3) world, best near the origin. Returns rotations (S,3,3) and
    camera centres (S,3) of all real solutions with positive distances, up to four per triple; triples of
    collinear points or rays give none. No plane z = 1 is involved, so rays may point backwards (360° photos).

    Source: Grunert 1841, as reviewed by Haralick et al. 1994, eq. 8-9 (quartic in the ratio of distances);
    assumes a central camera. The distances are polished by Newton steps on the three cosine laws.
    """
    sides = _squared_sides(points)
    cosines = _cosines(rays)
    distances, owner = _distances(sides, cosines)
    distances, good = _polish(distances, sides[owner], cosines[owner])
    distances, owner = distances[good], owner[good]
    in_camera = distances[:, :, None] * rays[owner]
    camera_frame, valid_camera = _triangle_frame(in_camera)
    world_frame, valid_world = _triangle_frame(points[owner])
    valid = valid_camera & valid_world
    rotation = (camera_frame @ np.swapaxes(world_frame, 1, 2))[valid]
    corner, corner_in_camera = points[owner, 0][valid], in_camera[valid, 0]
    centre = corner - np.einsum("sji,sj->si", rotation, corner_in_camera)
    return rotation, centre


def _squared_sides(points: FloatArray) -> FloatArray:
    """Squared sides a^2, b^2, c^2 opposite to points 1, 2, 3: (B,3)."""
    opposite = points[:, [1, 0, 0]] - points[:, [2, 2, 1]]
    out: FloatArray = np.einsum("bij,bij->bi", opposite, opposite)
    return out


def _cosines(rays: FloatArray) -> FloatArray:
    """Cosines of the angles between the rays opposite to rays 1, 2, 3: (B,3)."""
    out: FloatArray = np.einsum("bij,bij->bi", rays[:, [1, 0, 0]], rays[:, [2, 2, 1]])
    return out


def _quartic(sides: FloatArray, cosines: FloatArray) -> FloatArray:
    """Coefficients of the quartic in v = s3 / s1, highest power first: (B,5)."""
    a2, b2, c2 = sides.T
    ca, cb, cg = cosines.T
    difference, total, c_b = (a2 - c2) / b2, (a2 + c2) / b2, c2 / b2
    return np.stack(
        [
            (difference - 1) ** 2 - 4 * c_b * ca**2,
            4 * (difference * (1 - difference) * cb - (1 - total) * ca * cg + 2 * c_b * ca**2 * cb),
            2
            * (
                difference**2
                - 1
                + 2 * difference**2 * cb**2
                + 2 * (b2 - c2) / b2 * ca**2
                - 4 * total * ca * cb * cg
                + 2 * (b2 - a2) / b2 * cg**2
            ),
            4 * (-difference * (1 + difference) * cb + 2 * a2 / b2 * cg**2 * cb - (1 - total) * ca * cg),
            (1 + difference) ** 2 - 4 * a2 / b2 * cg**2,
        ],
        axis=1,
    )


def _distances(sides: FloatArray, cosines: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distances (S,3) of the candidates and the triple (S,) each belongs to."""
    with np.errstate(divide="ignore", invalid="ignore"):
        coefficients = _quartic(sides, cosines)
        monic = coefficients[:, 1:] / coefficients[:, :1]
    usable = np.isfinite(monic).all(axis=1)
    companion = np.zeros((int(usable.sum()), 4, 4))
    companion[:, 0] = -monic[usable]
    companion[:, [1, 2, 3], [0, 1, 2]] = 1.0
    roots = np.linalg.eigvals(companion)
    owner, which = np.nonzero((np.abs(roots.imag) < 1e-3 * (1 + np.abs(roots.real))) & (roots.real > 0))
    v = roots.real[owner, which]
    owner = np.flatnonzero(usable)[owner]
    a2, b2, c2 = sides[owner].T
    ca, cb, cg = cosines[owner].T
    difference = (a2 - c2) / b2
    with np.errstate(divide="ignore", invalid="ignore"):
        u = ((difference - 1) * v**2 - 2 * difference * cb * v + 1 + difference) / (2 * (cg - v * ca))
        s1 = np.sqrt(b2 / (1 + v**2 - 2 * v * cb))
    distances = np.stack([s1, u * s1, v * s1], axis=1)
    good = np.isfinite(distances).all(axis=1) & (distances > 0).all(axis=1)
    return distances[good], owner[good]


def _polish(distances: FloatArray, sides: FloatArray, cosines: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Newton steps on s_j^2 + s_k^2 - 2 s_j s_k cos = side^2: distances and whether they converged."""
    first, second = [1, 0, 0], [2, 2, 1]
    for _ in range(4):
        sj, sk = distances[:, first], distances[:, second]
        error = sj**2 + sk**2 - 2 * sj * sk * cosines - sides
        jacobian = np.zeros((len(distances), 3, 3))
        rows = np.arange(3)
        jacobian[:, rows, first] = 2 * sj - 2 * sk * cosines
        jacobian[:, rows, second] = 2 * sk - 2 * sj * cosines
        regular = np.abs(np.linalg.det(jacobian)) > 1e-12 * np.prod(distances, axis=1)
        step = np.zeros_like(distances)
        step[regular] = np.linalg.solve(jacobian[regular], error[regular][:, :, None])[:, :, 0]
        distances = distances - step
    sj, sk = distances[:, first], distances[:, second]
    error = np.abs(sj**2 + sk**2 - 2 * sj * sk * cosines - sides)
    good: BoolArray = (error < 1e-8 * sides).all(axis=1) & (distances > 0).all(axis=1)
    return distances, good


def _triangle_frame(triangle: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Right-handed frames (B,3,3, axes in columns) of triangles (B,3,3), and whether each has an area."""
    side = triangle[:, 1] - triangle[:, 0]
    other = triangle[:, 2] - triangle[:, 0]
    normal = np.cross(side, other)
    side_length = np.linalg.norm(side, axis=1)
    area = np.linalg.norm(normal, axis=1)
    valid: BoolArray = area > 1e-9 * np.maximum(side_length**2, 1e-300)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = side / side_length[:, None]
        z = normal / area[:, None]
    return np.stack([x, np.cross(z, x), z], axis=2), valid
