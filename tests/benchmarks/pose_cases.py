"""Synthetic cases of the published protocol: regions in space, a camera, masks, boundary errors."""

from dataclasses import dataclass, field

import numpy as np
from fresco.core.cameras import PerspectiveCamera
from fresco.core.geometry.outlines import fill_loops, mask_loops
from pose_shapes import template_shapes
from scipy.spatial import Delaunay, cKDTree
from scipy.spatial.transform import Rotation

WIDTH, HEIGHT = 2376, 1584
PIXELS_PER_METRE = 800  # raster on which 3-D boundary errors are drawn


@dataclass
class Case:
    """One case: masks seen by a camera and the surfaces they show; `clean` are the uncorrupted masks."""

    camera: object
    rotation: np.ndarray
    translation: np.ndarray
    masks: list
    clean: list
    surfaces: list
    outlines: list = field(default_factory=list)  # clean outlines in the world, (n,3) each, per region
    shapes: list = field(default_factory=list)


def perspective_camera():
    return PerspectiveCamera(WIDTH, HEIGHT, [[1500, 0, 1187.5], [0, 1500, 791.5], [0, 0, 1]])


def make_case(
    rng,
    camera=None,
    regions=1,
    image_error=0.0,
    surface_error=0.0,
    curved=False,
    depth=(2.0, 6.0),
    offset=10_000.0,
    spread=1.0,
    shapes=None,
):
    """Draw until every region is whole in the photo, seen at less than 75 degrees, and apart."""
    camera = camera or perspective_camera()
    shapes = shapes or template_shapes()
    while True:
        names = list(rng.choice(sorted(shapes), regions, replace=False))
        frames = [_region_frame(rng, i, spread) for i in range(regions)]
        pose = _camera_pose(rng, depth, spread)
        outlines = [
            [_placed(_dense(loop), frame, curved) for loop in shapes[name]]
            for name, frame in zip(names, frames, strict=True)
        ]
        clean = _visible_masks(camera, pose, frames, outlines)
        if clean is not None:
            break
    surfaces = [
        _placed_mesh(_corrupted_shape(rng, shapes[name], surface_error), frame, curved)
        for name, frame in zip(names, frames, strict=True)
    ]
    masks = [corrupt(rng, mask, image_error) for mask in clean]
    return _in_the_world(rng, Case(camera, *pose, masks, clean, surfaces, outlines, names), offset)


def _region_frame(rng, index, spread):
    """Rotation and origin: the first at the origin, the others ±[1, 2] m off and turned by ±30°."""
    if index == 0:
        return np.eye(3), np.zeros(3)
    origin = rng.choice([-1, 1], 3) * rng.uniform(1, 2, 3) * spread * np.array([1, 1, 0.5])
    return Rotation.from_euler("xyz", rng.uniform(-30, 30, 3), degrees=True).as_matrix(), origin


def _camera_pose(rng, depth, spread):
    rotation = Rotation.from_euler("xyz", rng.uniform(-40, 40, 3), degrees=True).as_matrix()
    sideways = rng.choice([-1, 1], 2) * rng.uniform(0.5, 2, 2) * spread
    return rotation, np.array([*sideways, rng.uniform(*depth)])


def _dense(loop, step=0.01):
    """Loop with vertices at most `step` apart."""
    following = np.roll(loop, -1, axis=0)
    parts = []
    for a, b in zip(loop, following, strict=True):
        count = max(1, int(np.ceil(np.linalg.norm(b - a) / step)))
        parts.append(a + (b - a) * (np.arange(count) / count)[:, None])
    return np.concatenate(parts)


def _placed(points, frame, curved):
    """Plane shape to space; curved ones are bent over a cylinder of 0.7 m radius, its axis along y."""
    x, y = points[:, 0], points[:, 1]
    radius = 0.7
    if curved:
        local = np.stack([radius * np.sin(x / radius), y, radius * (1 - np.cos(x / radius))], axis=1)
    else:
        local = np.stack([x, y, np.zeros_like(x)], axis=1)
    return local @ frame[0].T + frame[1]


def _visible_masks(camera, pose, frames, outlines):
    rotation, translation = pose
    masks, used = [], np.zeros((camera.height, camera.width), dtype=bool)
    for (turn, _), loops in zip(frames, outlines, strict=True):
        points = np.concatenate(loops) @ rotation.T + translation
        normal = rotation @ turn[:, 2]
        middle = points.mean(axis=0)
        if normal @ middle < np.cos(np.radians(75)) * np.linalg.norm(middle):
            return None
        projected = project_loops(camera, rotation, translation, loops)
        pixels = np.concatenate(projected)
        if not np.all(np.isfinite(pixels)) or not np.all(camera.in_frame(pixels, margin=20)):
            return None
        mask = fill_loops(projected, camera.width, camera.height)
        if np.any(mask & used) or mask.sum() < 2000:
            return None
        used |= mask
        masks.append(mask)
    return masks


def project_loops(camera, rotation, translation, loops):
    return [camera.project(loop @ rotation.T + translation) for loop in loops]


def corrupt(rng, mask, error):
    """Squares of 3-8 % of √area set or cleared along the boundary until they changed `error` of the area."""
    area = np.count_nonzero(mask)
    out = mask.copy()
    boundary = np.concatenate(mask_loops(mask))
    changed, added = 0, rng.random() < 0.5
    while changed < error * area:
        side = rng.uniform(0.03, 0.08) * np.sqrt(area)
        u, v = boundary[rng.integers(len(boundary))] + 0.5 - side / 2
        square = out[max(0, round(v)) : round(v + side), max(0, round(u)) : round(u + side)]
        changed += np.count_nonzero(square != added)
        square[:] = added
        added = not added
    return out


def _corrupted_shape(rng, loops, error):
    """Shape as (vertices (n,2), triangles): exact, or with squares drawn on a fine raster."""
    if error == 0:
        return triangulated([_dense(loop, 0.04) for loop in loops])
    scale, size = PIXELS_PER_METRE, int(1.6 * PIXELS_PER_METRE)
    turn = Rotation.from_euler("z", rng.uniform(0, 360), degrees=True).as_matrix()[:2, :2]
    raster = fill_loops([loop @ turn.T * scale + size / 2 for loop in loops], size, size)
    cracks = mask_loops(corrupt(rng, raster, error))
    return triangulated(
        [_straightened((loop - size / 2) / scale) @ turn for loop in cracks if len(loop) > 20]
    )


def _straightened(loop):
    """Crack polygon with vertices only where it turns, long runs cut."""
    before, after = np.roll(loop, 1, axis=0), np.roll(loop, -1, axis=0)
    turn = (loop - before)[:, 0] * (after - loop)[:, 1] - (loop - before)[:, 1] * (after - loop)[:, 0]
    return _dense(loop[np.abs(turn) > 1e-12], 0.04)


def triangulated(loops):
    """Triangles inside loops (n,2): vertices and faces, by Delaunay with the loops' interiors kept."""
    points = np.concatenate(loops)
    low, high = points.min(axis=0), points.max(axis=0)
    step = 0.05
    grid = np.stack(
        np.meshgrid(*(np.arange(a, b, step) for a, b in zip(low, high, strict=True))), axis=-1
    ).reshape(-1, 2)
    return _constrained(loops, grid)


def _constrained(loops, grid):
    """Delaunay triangulation that keeps all boundary edges: boundary edges that are missing are halved."""
    for _ in range(12):
        points = np.concatenate(loops)
        distance = cKDTree(points).query(grid)[0]
        everything = np.concatenate([points, grid[distance > 0.02]])
        triangles = Delaunay(everything).simplices
        have = {frozenset(e) for t in triangles.tolist() for e in ((t[0], t[1]), (t[1], t[2]), (t[2], t[0]))}
        start, missing, fixed = 0, 0, []
        for loop in loops:
            n = len(loop)
            pieces = []
            for i in range(n):
                pieces.append(loop[i])
                if frozenset((start + i, start + (i + 1) % n)) not in have:
                    pieces.append(0.5 * (loop[i] + loop[(i + 1) % n]))
                    missing += 1
            fixed.append(np.array(pieces))
            start += n
        if missing == 0:
            break
        loops = fixed
    centroids = everything[triangles].mean(axis=1)
    return everything, triangles[_inside(centroids, loops)]


def _inside(points, loops):
    inside = np.zeros(len(points), dtype=bool)
    for loop in loops:
        for a, b in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            crosses = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
            if a[1] != b[1]:
                x = a[0] + (points[:, 1] - a[1]) * (b[0] - a[0]) / (b[1] - a[1])
                inside ^= crosses & (points[:, 0] < x)
    return inside


def _placed_mesh(mesh, frame, curved):
    points, faces = mesh
    return _placed(points, frame, curved), faces


def _in_the_world(rng, case, offset):
    """Move the whole scene rigidly, so that neither axes nor origin tell anything."""
    world = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    shift = rng.uniform(-offset, offset, 3)
    case.surfaces = [(v @ world.T + shift, f) for v, f in case.surfaces]
    case.outlines = [[loop @ world.T + shift for loop in loops] for loops in case.outlines]
    case.rotation = case.rotation @ world.T
    case.translation = case.translation - case.rotation @ shift
    return case
