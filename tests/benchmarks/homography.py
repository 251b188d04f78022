"""Benchmark of homographies: `python tests/benchmarks/homography.py [--write] [--count N] [--seed S]`.

Single planes between two perspective photos, and five photos of three planes, with the shapes of the pose
benchmark and boundary errors in both photos; `--write` puts the tables into docs/benchmarks.md. CPU times.
"""

import argparse
import os
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pose_cases
from fresco.core.errors import PoseNotFound
from fresco.core.geometry.rigid import rotation_angle
from fresco.core.homography import (
    estimate_homography,
    estimate_poses_and_planes,
    plane_from_homography,
    relative_poses_from_homography,
)
from fresco.core.regions import ImageRegion
from pose_shapes import template_shapes
from scipy.spatial.transform import Rotation

DOCUMENT = Path(__file__).parents[2] / "docs" / "benchmarks.md"
CAMERA = pose_cases.perspective_camera()
ERRORS = (0.0, 0.05, 0.12, 0.2)
PHOTOS, PLANES = 5, 3


def drawn(rng, photos, planes, turn, depth):
    """Poses, frames and outlines of planes that all photos show whole, and their masks."""
    shapes = template_shapes()
    names = list(rng.choice(sorted(shapes), planes, replace=False))
    while True:
        frames = [pose_cases._region_frame(rng, k, 1.0) for k in range(planes)]
        outlines = [
            [pose_cases._placed(pose_cases._dense(loop), frame, False) for loop in shapes[name]]
            for name, frame in zip(names, frames, strict=True)
        ]
        poses, masks = [], []
        for _ in range(40):
            rotation = Rotation.from_euler("xyz", rng.uniform(-turn, turn, 3), degrees=True).as_matrix()
            pose = (rotation, np.array([*rng.uniform(-1.5, 1.5, 2), rng.uniform(*depth)]))
            seen = pose_cases._visible_masks(CAMERA, pose, frames, outlines)
            if seen is not None:
                poses, masks = [*poses, pose], [*masks, seen]
            if len(poses) == photos:
                return poses, frames, outlines, masks


def degrees_between(one, other):
    cosine = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def plane_in(pose, frame):
    """Unit normal and distance of a plane in a camera's frame."""
    normal, point = pose[0] @ frame[0][:, 2], pose[0] @ frame[1] + pose[1]
    normal = normal * np.sign(normal @ point)
    return normal, normal @ point


def single_case(rng, error):
    """One plane in two photos: what is off, or None where the outline was refused."""
    poses, frames, outlines, masks = drawn(rng, 2, 1, 40, (2, 5))
    images = [ImageRegion.from_mask(pose_cases.corrupt(rng, seen[0], error)) for seen in masks]
    start = time.process_time()
    try:
        found = estimate_homography(CAMERA, CAMERA, *images)
    except PoseNotFound:
        return None
    seconds = time.process_time() - start
    (rotation1, shift1), (rotation2, shift2) = poses
    rotation, points = rotation2 @ rotation1.T, np.concatenate(outlines[0])
    translation = shift2 - rotation @ shift1
    carried = CAMERA.project((points @ rotation1.T + shift1) @ found.matrix.T)
    off = np.sqrt(np.mean(np.sum((carried - CAMERA.project(points @ rotation2.T + shift2)) ** 2, axis=1)))
    nearest = min(
        relative_poses_from_homography(found.matrix, found.rays),
        key=lambda pose: rotation_angle(pose.rotation @ rotation.T),
    )
    normal, distance = plane_in(poses[0], frames[0])
    try:
        plane, away = plane_from_homography(found.matrix, CAMERA, CAMERA, rotation, translation, images[0])
    except PoseNotFound:  # of several maps that explain the outlines the wrong one
        plane, away = np.full(3, np.nan), np.nan
    return (
        off, 100 * off / np.sqrt(images[1].area), found.transfer_error, found.locked, found.ambiguous,
        np.degrees(rotation_angle(nearest.rotation @ rotation.T)),
        degrees_between(nearest.translation, translation),
        degrees_between(plane, normal), 100 * abs(away / distance - 1), seconds,
    )  # fmt: skip


def network_case(rng, error):
    """Five photos of three planes: what is off; all of it 90 and 1000 where a camera was not placed."""
    poses, frames, _, masks = drawn(rng, PHOTOS, PLANES, 30, (3, 6))
    regions = [[ImageRegion.from_mask(pose_cases.corrupt(rng, m, error)) for m in seen] for seen in masks]
    start = time.process_time()
    try:
        found = estimate_poses_and_planes([CAMERA] * PHOTOS, regions)
    except PoseNotFound:
        return 90.0, 90.0, 1000.0, 90.0, 100.0, False, time.process_time() - start
    seconds = time.process_time() - start
    rotations, translations, normals, distances = (np.nan_to_num(part, nan=9.0) for part in found)
    planes = [plane_in(poses[0], frame) for frame in frames]
    scale = planes[0][1] / distances[0]
    turns, shifts = [], []
    for pose, rotation, translation in zip(poses[1:], rotations[1:], translations[1:], strict=True):
        truth = pose[0] @ poses[0][0].T
        shift = truth.T @ (pose[1] - truth @ poses[0][1])
        placed = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
        turns.append(np.degrees(rotation_angle(rotation @ truth.T)) if placed else 90.0)
        shifts.append(1000 * np.linalg.norm(rotation.T @ translation * scale - shift) if placed else 1000.0)
    tilts = [degrees_between(normal, truth) for normal, (truth, _) in zip(normals, planes, strict=True)]
    away = [100 * abs(d * scale / truth - 1) for d, (_, truth) in zip(distances, planes, strict=True)]
    worst = max(turns)
    return (
        np.median(turns),
        worst,
        np.median(shifts),
        np.median(tilts),
        np.median(away[1:]),
        found.locked,
        seconds,
    )


SINGLE = (
    "one plane, two photos", "carried px", "% of size", "told px", "coincide %", "ambiguous %", "refused %",
    "rotation °", "direction °", "plane °", "distance %", "s",
)  # fmt: skip
SEVERAL = (
    f"{PHOTOS} photos, {PLANES} planes", "rotation °", "all within 0.5 ° %", "centre mm", "normals °",
    "distances %", "coincide %", "s",
)  # fmt: skip


def row(*cells):
    return f"| {' | '.join(cells)} |"


def single_row(error, count, seed):
    rng = np.random.default_rng(seed)
    cases = [single_case(rng, error) for _ in range(count)]
    known = np.array([case for case in cases if case is not None], dtype=float)
    off, relative, told, _, _, rotation, direction, tilt, away, seconds = np.nanmedian(known, axis=0)
    shares = [*np.mean(known[:, 3:5], axis=0), 1 - len(known) / count]
    return row(
        f"boundary error {100 * error:.0f} %",
        *(f"{value:.2f}" for value in (off, relative, told)),
        *(f"{100 * share:.0f}" for share in shares),
        *(f"{value:.2f}" for value in (rotation, direction, tilt, away, seconds)),
    )


def several_row(error, count, seed):
    rng = np.random.default_rng(seed)
    cases = np.array([network_case(rng, error) for _ in range(max(count // 4, 2))], dtype=float)
    rotation, _, centre, tilt, away, _, seconds = np.median(cases, axis=0)
    return row(
        f"boundary error {100 * error:.0f} %",
        f"{rotation:.3f}",
        f"{100 * np.mean(cases[:, 1] < 0.5):.0f}",
        *(f"{value:.3f}" for value in (centre, tilt, away)),
        f"{100 * np.mean(cases[:, 5]):.0f}",
        f"{seconds:.1f}",
    )


def tables(count, seed):
    lines = [
        f"`python tests/benchmarks/homography.py --write` (seed {seed}, {count} cases a row, a quarter of it",
        "with five photos; shapes and boundary errors as for poses, in every photo). Medians. *Carried*:",
        "points of the outline carried to the second photo, rms; *told*: the error that the result states;",
        "*plane* and *distance*: with the pose known, where they do not contradict it.",
        "",
        row(*SINGLE),
        "|" + "---|" * len(SINGLE),
        *(single_row(error, count, seed) for error in ERRORS),
        "",
        row(*SEVERAL),
        "|" + "---|" * len(SEVERAL),
        *(several_row(error, count, seed) for error in ERRORS[:3]),
    ]
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=2029)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    text = tables(options.count, options.seed)
    print(text)
    if options.write:
        begin, end = "<!-- homographies -->", "<!-- /homographies -->"
        head, rest = DOCUMENT.read_text().split(begin, 1)
        DOCUMENT.write_text(f"{head}{begin}\n{text}\n{end}{rest.split(end, 1)[1]}")


if __name__ == "__main__":
    main()
