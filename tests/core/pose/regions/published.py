"""The published algorithms as they stand, slow and plain: what the production solver is compared with.

Source: method.md, Alg. 1-3, eq. 3.5-3.21.
"""

from math import factorial

import numpy as np
from fresco.core.geometry.rigid import exp_so3
from scipy.optimize import least_squares

PLANE_POWERS = [(n, m) for n in range(4) for m in range(4) if n + m <= 4]
SPHERE_POWERS = [(i, j, k) for i in range(3) for j in range(3) for k in range(3) if i + j + k <= 2]


def triangle_moment(triangle, i, j):
    """Integral of `x^i y^j` over a plane triangle (3,2) by the recursions S, D and C."""
    a, b, c = triangle

    def last(p, q):
        if p < 0 or q < 0:
            return 0.0
        return 1.0 if p + q == 0 else c[0] * last(p - 1, q) + c[1] * last(p, q - 1)

    def two(p, q):
        if p < 0 or q < 0:
            return 0.0
        return 1.0 if p + q == 0 else b[0] * two(p - 1, q) + b[1] * two(p, q - 1) + last(p, q)

    def three(p, q):
        if p < 0 or q < 0:
            return 0.0
        return 1.0 if p + q == 0 else a[0] * three(p - 1, q) + a[1] * three(p, q - 1) + two(p, q)

    doubled = abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
    return doubled * factorial(i) * factorial(j) / factorial(i + j + 2) * three(i, j)


def plane_moments(vertices, faces, powers=PLANE_POWERS):
    """Moments of a triangulated plane patch (V,2), (F,3): eq. 3.15."""
    return np.array([sum(triangle_moment(vertices[list(face)], i, j) for face in faces) for i, j in powers])


def sphere_integrals(rays, faces, powers=SPHERE_POWERS, split=4):
    """Integrals of `X^l Y^m Z^n` over spherical triangles of unit rays (V,3): Alg. 2.

    Each triangle is cut into 4^split ones, whose exact solid angles weigh the values at their middles.
    """
    corners = rays[np.asarray(faces)]
    for _ in range(split):
        a, b, c = np.swapaxes(corners, 0, 1)
        ab, bc, ca = (_unit(x + y) for x, y in ((a, b), (b, c), (c, a)))
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        corners = np.concatenate([np.stack(part, axis=1) for part in parts])
    return _weighted(_unit(corners.sum(axis=1)), np.abs(solid_angles(corners)), powers)


def pixel_integrals(camera, mask, powers=SPHERE_POWERS):
    """The same integrals over the pixels of a mask (H,W), each weighed by its solid angle: Alg. 1."""
    v, u = np.nonzero(mask)
    around = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
    a, b, c, d = (camera.unproject(np.column_stack([u + du, v + dv]).astype(float)) for du, dv in around)
    size = np.abs(solid_angles(np.stack([a, b, c], 1))) + np.abs(solid_angles(np.stack([a, c, d], 1)))
    return _weighted(camera.unproject(np.column_stack([u, v]).astype(float)), size, powers)


def solid_angles(corners):
    """Solid angles (n,) of spherical triangles (n,3,3). Source: Van Oosterom and Strackee 1983."""
    a, b, c = np.swapaxes(corners, 0, 1)
    top = np.sum(a * np.cross(b, c), axis=1)
    return 2 * np.arctan2(top, 1 + np.sum(a * b, 1) + np.sum(b * c, 1) + np.sum(c * a, 1))


def solve_plane(observed, patches, rotation, translation):
    """Alg. 3 from a start: least squares on the moments of patches (vertices (V,3), faces) on the plane."""

    def integrals(points, faces):
        return plane_moments(points[:, :2] / points[:, 2:], faces)

    return _solved(observed, patches, rotation, translation, integrals)


def solve_sphere(observed, patches, rotation, translation):
    """Alg. 2 from a start."""

    def integrals(points, faces):
        return sphere_integrals(_unit(points), faces)

    return _solved(observed, patches, rotation, translation, integrals)


def _solved(observed, patches, rotation, translation, integrals):
    scale = np.maximum(np.abs(np.array(observed)), 1e-6)
    centre = np.concatenate([vertices for vertices, _ in patches]).mean(axis=0)
    middle = rotation @ centre + translation

    def moved(step, vertices):
        return (vertices - centre) @ (exp_so3(step[:3]) @ rotation).T + middle + step[3:]

    def residuals(step):
        found = [integrals(moved(step, vertices), faces) for vertices, faces in patches]
        return ((np.array(found) - observed) / scale).ravel()

    step = least_squares(residuals, np.zeros(6), method="lm", xtol=1e-14, ftol=1e-14).x
    turned = exp_so3(step[:3]) @ rotation
    return turned, middle + step[3:] - turned @ centre


def _weighted(rays, weights, powers):
    return np.array([np.sum(weights * np.prod(rays ** np.array(power), axis=1)) for power in powers])


def _unit(rays):
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)
