"""Plane regions seen by two or more cameras whose poses are known."""

import numpy as np
from fresco.core.geometry.boundary import subdivided
from fresco.core.geometry.outlines import fill_loops
from fresco.core.geometry.rigid import exp_so3
from fresco.core.regions import ImageRegion

SHAPES = {
    "ell": [(0, 0), (1, 0), (1, 0.3), (0.35, 0.3), (0.35, 0.8), (0, 0.8)],
    "prow": [(0, 0.2), (0.7, 0), (1, 0.4), (0.5, 0.9), (0.45, 0.5), (0.1, 0.65)],
    "step": [(0, 0), (0.3, 0), (0.3, 0.25), (0.6, 0.25), (0.6, 0.55), (1, 0.55), (1, 0.8), (0, 0.8)],
    "triangle": [(0, 0), (1, 0.2), (0.3, 0.9)],
    "square": [(0, 0), (1, 0), (1, 1), (0, 1)],
}
PLACES = {
    "ell": ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    "prow": ([0.4, 0.3, 0.2], [1.2, 0.5, 0.4]),
    "step": ([-0.35, 0.3, 0.1], [-0.6, -1.1, -0.4]),
    "triangle": ([0.1, 0.0, 0.0], [0.0, 0.0, 0.0]),
    "square": ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
}
POSES = [
    (exp_so3([0.1, -0.2, 0.05]), np.array([-0.3, 0.1, 3.4])),
    (exp_so3([-0.15, 0.35, 0.3]), np.array([0.5, -0.2, 3.1])),
    (exp_so3([0.3, 0.1, -0.4]), np.array([0.1, 0.4, 3.8])),
    (exp_so3([-0.2, -0.4, 0.1]), np.array([-0.4, -0.3, 3.6])),
]


def corners(name):
    """Corners (n,3) of a region in the scene."""
    spin, place = PLACES[name]
    flat = np.column_stack([np.array(SHAPES[name]) - 0.5, np.zeros(len(SHAPES[name]))])
    return flat @ exp_so3(spin).T + place


def region(camera, pose, name, error=0.0, seed=0):
    """A region as a camera at a pose sees it; `error` is the share of its area that is drawn wrongly."""
    rotation, translation = pose
    outline = camera.project(subdivided(corners(name), 0.01) @ rotation.T + translation)
    mask = fill_loops([outline], camera.width, camera.height)
    return ImageRegion.from_mask(bitten(mask, error, seed), name)


def bitten(mask, error, seed):
    """Mask with squares set and cleared along its boundary until a share of its area has changed."""
    rng = np.random.default_rng(seed)
    changed, size = mask.copy(), int(0.06 * np.sqrt(mask.sum()))
    inner = mask & np.roll(mask, 1, 0) & np.roll(mask, -1, 0) & np.roll(mask, 1, 1) & np.roll(mask, -1, 1)
    v, u = np.nonzero(mask & ~inner)
    while np.count_nonzero(changed != mask) < error * mask.sum():
        k = rng.integers(len(v))
        square = (slice(max(v[k] - size, 0), v[k] + size), slice(max(u[k] - size, 0), u[k] + size))
        changed[square] = rng.random() < 0.5
    return changed


def relative(first, second):
    """Rotation and translation from the first camera's frame to the second's."""
    rotation = second[0] @ first[0].T
    return rotation, second[1] - rotation @ first[1]


def plane(pose, name):
    """Unit normal and distance of a region's plane in a camera's frame."""
    points = corners(name) @ pose[0].T + pose[1]
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    normal *= np.sign(normal @ points[0]) / np.linalg.norm(normal)
    return normal, float(normal @ points[0])


def true_homography(first, second, name):
    rotation, translation = relative(first, second)
    normal, distance = plane(first, name)
    return rotation + np.outer(translation, normal) / distance
