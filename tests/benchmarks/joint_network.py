"""Hundreds of photos refined together, from pixels to poses.

python tests/benchmarks/joint_network.py [PHOTOS] [--seed NUMBER]

Photos of a closed courtyard whose windows and pillars are all alike are made by warping textures. Starts are
off as poses from regions are; some of them by a whole degree, which their covariance does not tell. People
stand about. Measured are time and memory by stage, errors against the truth and normalised errors².
"""

import argparse
import resource
import tempfile
import time
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from fresco.core.cameras import PerspectiveCamera
from fresco.core.geometry.rigid import exp_so3, log_so3
from fresco.core.jobs import drain
from fresco.core.photos import View
from fresco.core.pose.joint import refine_poses_jointly_job

SIZE = np.array([16.0, 12.0, 5.5])
"""Inside of the courtyard (m)."""

TEXEL = 0.004
"""Side of a texel (m)."""

CAMERA = PerspectiveCamera(1500, 1000, [[1200, 0, 749.5], [0, 1200, 499.5], [0, 0, 1]])

SIGMA = np.repeat([np.radians(0.1), 0.01], 3)
"""Standard deviations (rad, m) per axis of the starts."""

WRONG = 0.03
"""Share of the starts that are turned by a degree."""

MESH_STEP, SCAN_NOISE = 0.06, 0.002


@dataclass(frozen=True, eq=False)
class Board:
    """A textured rectangle: `corner` (3,), sides `along` and `up` (3,) m, `levels`: each half as fine."""

    corner: np.ndarray
    along: np.ndarray
    up: np.ndarray
    levels: list

    def piece(self, low, high):
        """Corners (4,3) of the part between shares `low` and `high` (2,) of the sides."""
        shares = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
        return self.corner + shares @ np.stack([self.along, self.up])

    @property
    def normal(self):
        out = np.cross(self.up, self.along)
        return out / np.linalg.norm(out)


def stone(rng, width, height):
    """Texture levels of a wall `width` x `height` m: grain, stains and stones."""
    shape = round(height / TEXEL), round(width / TEXEL)
    grey = np.zeros(shape, np.float32)
    for step, weight in ((2, 9), (5, 12), (12, 14), (40, 14), (150, 14)):
        coarse = rng.normal(0, weight, (shape[0] // step + 2, shape[1] // step + 2)).astype(np.float32)
        grey += cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC)
    for _ in range(int(12 * width * height)):
        at = rng.uniform((0, 0), shape[::-1]).astype(int).tolist()
        axes = rng.uniform(4, 25, 2).astype(int).tolist()
        cv2.ellipse(grey, at, axes, float(rng.uniform(0, 180)), 0, 360, float(rng.normal(0, 40)), -1)
    levels = [np.clip(grey + 120, 5, 250).astype(np.uint8)]
    while min(levels[-1].shape) > 16 and len(levels) < 5:
        half = (levels[-1].shape[1] + 1) // 2, (levels[-1].shape[0] + 1) // 2
        levels.append(cv2.resize(levels[-1], half, interpolation=cv2.INTER_AREA))
    return levels


def courtyard(rng):
    """Boards of walls and floor, and boxes of boards each: pillars and windows, all of one make."""
    x, y, z = SIZE
    sides = [
        ((-x / 2, y / 2, z), (x, 0, 0)),
        ((x / 2, y / 2, z), (0, -y, 0)),
        ((x / 2, -y / 2, z), (-x, 0, 0)),
        ((-x / 2, -y / 2, z), (0, y, 0)),
    ]
    walls, boxes = [], []
    makes = {size: [stone(rng, *s) for s in _box_sides(size)] for size in ((0.5, 0.3, 5.0), (1.2, 0.15, 1.6))}
    for corner, along in sides:
        corner, along = np.array(corner), np.array(along, float)
        length = np.linalg.norm(along)
        walls.append(Board(corner, along, np.array([0, 0, -z]), stone(rng, length, z)))
        for number in range(int(length / 3)):
            for size, shift, low in (((0.5, 0.3, 5.0), 0.6, 0.0), ((1.2, 0.15, 1.6), 2.2, 1.9)):
                middle = corner + along / length * (3 * number + shift) - [0, 0, z - low]
                boxes.append(_box(middle, along / length, size, makes[size]))
    floor = Board(np.array([-x / 2, y / 2, 0]), np.array([x, 0, 0]), np.array([0, -y, 0]), stone(rng, x, y))
    return [*walls, floor], boxes


def _box_sides(size):
    width, depth, height = size
    return [(width, height), (depth, height), (depth, height), (width, depth), (width, depth)]


def _box(foot, along, size, textures):
    """Front, two sides, top and bottom of a box that stands out of a wall; `foot`: its lower middle."""
    width, depth, height = size
    up = np.array([0, 0, 1.0])
    out = np.cross(along, up)
    top_left = foot - along * width / 2 + out * depth + up * height
    right = along * width
    return [
        Board(top_left, right, -up * height, textures[0]),
        Board(top_left - out * depth, out * depth, -up * height, textures[1]),
        Board(top_left + right, -out * depth, -up * height, textures[2]),
        Board(top_left - out * depth, right, out * depth, textures[3]),
        Board(top_left - up * height, right, -out * depth, textures[4]),
    ]


def draw(photo, board, low, high, rotation, centre):
    """Warp a part of a board into a photo (H,W), over what is there already."""
    corners = (board.piece(low, high) - centre) @ rotation.T
    polygon = _in_front(corners)
    if len(polygon) < 3:
        return
    outline = polygon @ CAMERA.K.T
    outline = outline[:, :2] / outline[:, 2:]
    start = np.clip(np.floor(outline.min(axis=0)) - 1, 0, [CAMERA.width, CAMERA.height]).astype(int)
    end = np.clip(np.ceil(outline.max(axis=0)) + 2, 0, [CAMERA.width, CAMERA.height]).astype(int)
    if (end <= start).any():
        return
    distance = np.linalg.norm(corners.mean(axis=0))
    level = int(np.clip(np.floor(np.log2(distance / 1200 / TEXEL)), 0, len(board.levels) - 1))
    texture = board.levels[level]
    rows, columns = texture.shape
    # a texture's pixel centre (i, j) lies at the share (j + 0.5) / columns of the side
    plane = np.stack([board.along / columns, board.up / rows, board.corner - centre], axis=1)
    plane[:, 2] += 0.5 * (plane[:, 0] + plane[:, 1])
    moved = np.array([[1, 0, -start[0]], [0, 1, -start[1]], [0, 0, 1.0]])
    size = tuple((end - start).tolist())
    warped = cv2.warpPerspective(
        texture, moved @ CAMERA.K @ rotation @ plane, size, borderMode=cv2.BORDER_REPLICATE
    )
    mask = np.zeros(warped.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.round((outline - start) * 16).astype(np.int32), 255, cv2.LINE_8, 4)
    part = photo[start[1] : end[1], start[0] : end[0]]
    part[mask > 0] = warped[mask > 0]


def _in_front(corners, near=0.2):
    """Polygon (n,3) of which what lies nearer than `near` m is cut off (Sutherland and Hodgman 1974)."""
    kept = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if a[2] >= near:
            kept.append(a)
        if (a[2] >= near) != (b[2] >= near):
            kept.append(a + (near - a[2]) / (b[2] - a[2]) * (b - a))
    return np.array(kept)


def take_photo(boards, boxes, rotation, centre, rng):
    """Photo (H,W,3): walls in pieces, then boxes from far to near, then people, then noise."""
    photo = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    for board in boards:
        counts = np.maximum(np.round([np.linalg.norm(board.along), np.linalg.norm(board.up)]), 1).astype(int)
        for i in range(counts[0]):
            for j in range(counts[1]):
                draw(
                    photo,
                    board,
                    np.array([i, j]) / counts,
                    np.array([i + 1, j + 1]) / counts,
                    rotation,
                    centre,
                )
    for box in sorted(boxes, key=lambda b: -np.linalg.norm(b[0].corner - centre)):
        for board in box:
            if np.dot(board.normal, centre - board.corner) > 0:
                draw(photo, board, np.zeros(2), np.ones(2), rotation, centre)
    for _ in range(2):
        left, top = rng.integers((0, 300), (1400, 600))
        person = rng.integers(0, 255, (40, 12)).astype(np.uint8)
        person = cv2.resize(person, (80, 300), interpolation=cv2.INTER_CUBIC)
        part = photo[top : top + 300, left : left + 80]
        part[:] = person[: part.shape[0], : part.shape[1]]
    grey = np.clip(cv2.GaussianBlur(photo, (0, 0), 0.6) + rng.normal(0, 2.0, photo.shape), 0, 255)
    return np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)


def scan_mesh(boards, boxes, rng):
    """The courtyard as a scan: vertices (V,3), faces (F,3), noise along all axes."""
    vertices, faces, start = [], [], 0
    for board in [*boards, *(b for box in boxes for b in box)]:
        counts = [max(2, int(np.linalg.norm(side) / MESH_STEP) + 1) for side in (board.along, board.up)]
        s, t = (g.ravel() for g in np.meshgrid(*(np.linspace(0, 1, n) for n in counts)))
        vertices.append(board.corner + s[:, None] * board.along + t[:, None] * board.up)
        corner = (np.arange(counts[1] - 1)[:, None] * counts[0] + np.arange(counts[0] - 1)).ravel() + start
        square = np.stack([corner, corner + 1, corner + counts[0] + 1, corner + counts[0]], axis=1)
        faces += [square[:, [0, 2, 1]], square[:, [0, 3, 2]]]
        start += len(vertices[-1])
    points = np.concatenate(vertices)
    return points + rng.normal(0, SCAN_NOISE, points.shape), np.concatenate(faces).astype(np.int32)


def poses(rng, count):
    """Cameras on a ring, each looking across the courtyard."""
    for number in range(count):
        turn = 2 * np.pi * number / count
        centre = np.array([4.5 * np.cos(turn), 3.0 * np.sin(turn), 1.7]) + rng.normal(0, 0.3, 3)
        yaw, pitch = turn + np.pi + rng.normal(0, 0.15), rng.normal(0.08, 0.08)
        forward = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        upright = np.stack([right, np.cross(forward, right), forward])
        yield exp_so3([0, 0, rng.normal(0, 0.1)]) @ upright, centre


def started(view, wrong, rng):
    """The view with a start that is off as its covariance tells, or `wrong`: turned by a degree besides."""
    step = rng.normal(0, SIGMA)
    if wrong:
        axis = rng.normal(size=3)
        step[:3] += np.radians(1.0) * axis / np.linalg.norm(axis)
    rotation, centre = exp_so3(step[:3]) @ view.rotation, view.centre + step[3:]
    return replace(view, rotation=rotation, translation=-rotation @ centre, covariance=np.diag(SIGMA**2))


def errors(pose, truth):
    """Degrees, mm and normalised error² of a pose."""
    error = np.concatenate([log_so3(truth.rotation @ pose.rotation.T), truth.centre - pose.centre])
    sizes = np.degrees(np.linalg.norm(error[:3])), 1000 * np.linalg.norm(error[3:])
    return *sizes, error @ np.linalg.solve(pose.covariance, error)


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("photos", type=int, nargs="?", default=30)
    options.add_argument("--seed", type=int, default=7, help="another courtyard, other photos, other starts")
    chosen = options.parse_args()
    count, rng = chosen.photos, np.random.default_rng(chosen.seed)
    boards, boxes = courtyard(rng)
    vertices, faces = scan_mesh(boards, boxes, rng)
    with tempfile.TemporaryDirectory() as folder:
        views = []
        for number, (rotation, centre) in enumerate(poses(rng, count)):
            path = Path(folder) / f"{number:03d}.jpg"
            photo = take_photo(boards, boxes, rotation, centre, rng)
            cv2.imwrite(str(path), photo, [cv2.IMWRITE_JPEG_QUALITY, 95])
            views.append(View(CAMERA, rotation, -rotation @ centre, path, path.name))
        measure(views, vertices, faces, rng)


def measure(views, vertices, faces, rng):
    """Refine disturbed views and print time and memory by stage, then errors."""
    count = len(views)
    wrong = rng.permutation(count) < max(1, round(WRONG * count))
    starts = [started(view, bad, rng) for view, bad in zip(views, wrong, strict=True)]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{count} photos, {len(faces)} faces, {before:.0f} MB before")
    seconds, last = defaultdict(lambda: np.zeros(2)), [time.process_time(), time.perf_counter(), "Preparing"]

    def account(progress):
        now = [time.process_time(), time.perf_counter()]
        seconds[last[2]] += np.subtract(now, last[:2])
        last[:] = [*now, progress.message.split()[0]]

    solved = drain(refine_poses_jointly_job(starts, vertices, faces), account)
    for stage, (cpu, wall) in seconds.items():
        print(f"  {stage:12s} {cpu:7.1f} CPU s {wall:7.1f} s")
    total = sum(seconds.values())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"  all          {total[0]:7.1f} CPU s {total[1]:7.1f} s, peak {peak:.0f} MB")
    told(starts, solved, views, wrong)


def told(starts, solved, views, wrong):
    """Print errors of the usual and of the wrong starts, before and after."""
    for name, chosen in (("usual", ~wrong), ("wrong", wrong)):
        for when, those in (("start", starts), ("joint", solved)):
            table = np.array([errors(p, v) for p, v, c in zip(those, views, chosen, strict=True) if c])
            median, worst = np.median(table, axis=0), table.max(axis=0)
            print(
                f"  {name} {when}: {median[0]:.4f}°, {median[1]:.2f} mm (worst {worst[0]:.4f}°, "
                f"{worst[1]:.2f} mm), normalised error² {np.mean(table[:, 2]):.1f}"
            )
    kept = [pose.note for pose in solved if pose.note]
    print(f"  {len(kept)} kept, ties per photo {np.median([pose.ties for pose in solved]):.0f}")
    for note in kept[:3]:
        print("   ", note)


if __name__ == "__main__":
    main()
