"""Benchmark of pose refinement: `python tests/benchmarks/refine.py [--quick] [--write] [--data FOLDER]`.

Disturbs known poses and measures what each kind of refinement gives back: on a rendered wall in relief,
against OpenCV's refinement with the true points as the bound, and on a folder like fountain-P11. `--write`
puts the tables into docs/benchmarks.md.
"""

import argparse
import importlib.util
import json
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import cv2
import numpy as np
from fresco.core.cameras import PerspectiveCamera
from fresco.core.geometry.rigid import exp_so3, log_so3, rotation_angle
from fresco.core.jobs import drain
from fresco.core.photos import View
from fresco.core.pose import estimate_pose_from_points, refine_pose_by_edges, refine_poses_jointly
from fresco.core.scans import read_scan_job

ROOT = Path(__file__).resolve().parents[2]
MARKS = "<!-- refine -->", "<!-- /refine -->"


def main():
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--quick", action="store_true", help="fewer cases")
    options.add_argument("--write", action="store_true", help="put the tables into docs/benchmarks.md")
    options.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data" / "fountain-P11")
    chosen = options.parse_args()
    parts = [points_table(50 if chosen.quick else 300), perturbation_table(1 if chosen.quick else 3)]
    if chosen.data.exists():
        parts.append(real_table(chosen.data, 1 if chosen.quick else 2))
    else:
        print(f"{chosen.data} is not there: no real photos", file=sys.stderr)
    text = "\n\n".join(parts)
    print(text)
    if chosen.write:
        write_section(ROOT / "docs" / "benchmarks.md", text)


def errors(pose, truth):
    """Rotation (degrees), centre (m) and normalised squared error of a pose."""
    error = np.concatenate([log_so3(truth.rotation @ pose.rotation.T), truth.centre - pose.centre])
    angle = float(np.degrees(rotation_angle(pose.rotation @ truth.rotation.T)))
    nees = error @ np.linalg.solve(pose.covariance, error)
    return angle, float(np.linalg.norm(error[3:])), float(nees)


def disturbed(view, degrees, metres, rng):
    turn, move = rng.normal(size=3), rng.normal(size=3)
    rotation = exp_so3(np.radians(degrees) * turn / np.linalg.norm(turn)) @ view.rotation
    centre = view.centre + metres * move / np.linalg.norm(move)
    return replace(view, rotation=rotation, translation=-rotation @ centre, covariance=None)


def points_table(cases):
    """Poses from 12 points with 0.7 px noise, a third of them wrong, beside OpenCV told which are right."""
    rng = np.random.default_rng(0)
    camera = PerspectiveCamera(3000, 2000, [[2500, 0, 1499.5], [0, 2500, 999.5], [0, 0, 1]])
    ours, bound = [], []
    for _ in range(cases):
        rotation, centre = exp_so3(rng.normal(size=3)), rng.normal(size=3)
        rays = camera.unproject(rng.uniform([100, 100], [2900, 1900], (18, 2)))
        points = rays * rng.uniform(5, 9, (18, 1)) @ rotation + centre
        pixels = camera.project((points - centre) @ rotation.T) + rng.normal(0, 0.7, (18, 2))
        pixels[12:] = rng.uniform([0, 0], [3000, 2000], (6, 2))
        truth = View(camera, rotation, -rotation @ centre, np.zeros((1, 1, 3), np.uint8))
        ours.append(errors(estimate_pose_from_points(camera, pixels, points), truth))
        vector, translation = cv2.Rodrigues(rotation)[0], truth.translation.copy()
        cv2.solvePnPRefineLM(points[:12], pixels[:12], camera.K, None, vector, translation)
        found = cv2.Rodrigues(vector)[0]
        shift = np.linalg.norm(-found.T @ translation.ravel() - centre)
        bound.append((np.degrees(rotation_angle(found @ rotation.T)), shift))
    a, b = np.median(ours, axis=0), np.median(bound, axis=0)
    nees = np.mean(ours, axis=0)[2]
    return (
        "Poses from 18 points, 6 of them wrong, noise 0.7 px, 5 to 9 m away "
        f"({cases} cases, medians; the bound starts at the truth and is told the good points):\n\n"
        "| | rotation | centre | normalised error² (mean, ideal 6) |\n|---|---|---|---|\n"
        f"| `estimate_pose_from_points` | {a[0]:.4f}° | {1000 * a[1]:.2f} mm | {nees:.1f} |\n"
        f"| `cv2.solvePnPRefineLM`, bound | {b[0]:.4f}° | {1000 * b[1]:.2f} mm | |"
    )


def rendered_wall():
    """The wall of the unit tests."""
    path = ROOT / "tests" / "core" / "pose" / "conftest.py"
    spec = importlib.util.spec_from_file_location("relief_wall", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["relief_wall"] = module
    spec.loader.exec_module(module)
    return module.build_wall()


def perturbation_table(seeds):
    """Edges on a rendered wall 5 m away, 1440 x 1080 pixels."""
    wall = rendered_wall()
    camera = PerspectiveCamera(1440, 1080, [[1280, 0, 719.5], [0, 1280, 539.5], [0, 0, 1]])
    views = [wall.view(place, camera=camera) for place in ((0.8, -5.0, 0.4), (-1.5, -4.6, -0.3))]
    lines = [
        "Edge refinement of disturbed poses, rendered wall in relief 5 m away, 1440 x 1080 px, scan without "
        "colour; “back” is within 0.15° and 15 mm:\n",
        "| disturbed by | back | kept, said so | rotation | centre | normalised error² (median) |",
        "|---|---|---|---|---|---|",
    ]
    for degrees, metres in ((0.2, 0.02), (0.5, 0.05), (1.0, 0.1), (2.0, 0.2)):
        rng, results, kept = np.random.default_rng(1), [], 0
        for view in views:
            for _ in range(seeds):
                pose = refine_pose_by_edges(disturbed(view, degrees, metres, rng), wall.vertices, wall.faces)
                results.append(errors(pose, view))
                kept += not pose.refined
        angle, centre, nees = np.array(results).T
        back = np.mean((angle < 0.15) & (centre < 0.015))
        lines.append(
            f"| {degrees}°, {100 * metres:.0f} cm | {100 * back:.0f} % | {kept} of {len(results)} | "
            f"{np.median(angle):.3f}° | {1000 * np.median(centre):.1f} mm | {np.median(nees):.1f} |"
        )
    return "\n".join(lines)


def real_views(folder):
    cameras = json.loads((folder / "cameras.json").read_text(encoding="utf-8"))["cameras"]
    return [
        View(
            PerspectiveCamera(c["width"], c["height"], c["K"]),
            np.array(c["R"]),
            np.array(c["t"]),
            folder / "images" / c["image"],
            c["image"],
        )
        for c in cameras
    ]


def real_table(folder, seeds):
    """Per photo: start like a region pose (0.16 degrees, 2 cm), after edges, after all photos together."""
    views = real_views(folder)
    scan = drain(read_scan_job(folder / "mesh.ply"))
    vertices, faces = scan.vertices + scan.offset, scan.faces
    edges, joint, seconds = [], [], np.zeros(2)
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        starts = [disturbed(view, 0.16, 0.02, rng) for view in views]
        clock = time.process_time()
        edges.append(
            [errors(refine_pose_by_edges(s, vertices, faces), v) for s, v in zip(starts, views, strict=True)]
        )
        seconds[0] += time.process_time() - clock
        clock = time.process_time()
        joint.append(
            [errors(p, v) for p, v in zip(refine_poses_jointly(starts, vertices, faces), views, strict=True)]
        )
        seconds[1] += time.process_time() - clock
    edges, joint = np.median(edges, axis=0), np.median(joint, axis=0)
    lines = [
        f"{folder.name} from poses disturbed like region poses (0.16°, 20 mm; {seeds} draws), scan without "
        f"colour; {seconds[0] / seeds / len(views):.1f} CPU s per photo by edges, "
        f"{seconds[1] / seeds:.0f} CPU s for all together:\n",
        "| photo | edges alone | all photos together |",
        "|---|---|---|",
    ]
    for view, e, j in zip(views, edges, joint, strict=True):
        lines.append(
            f"| {view.name} | {e[0]:.3f}°, {1000 * e[1]:.1f} mm | {j[0]:.3f}°, {1000 * j[1]:.1f} mm |"
        )
    e, j = np.median(edges, axis=0), np.median(joint, axis=0)
    lines.append(
        f"| median | {e[0]:.3f}°, {1000 * e[1]:.1f} mm | {j[0]:.3f}°, {1000 * j[1]:.1f} mm |\n"
        f"| normalised error² (ideal 6) | {e[2]:.1f} | {j[2]:.1f} |"
    )
    return "\n".join(lines)


def write_section(path, text):
    page = path.read_text(encoding="utf-8") if path.exists() else "# Benchmarks\n"
    if MARKS[0] not in page:
        page = f"{page.rstrip()}\n\n## Pose refinement\n\n{MARKS[0]}\n{MARKS[1]}\n"
    before, rest = page.split(MARKS[0], 1)
    after = rest.split(MARKS[1], 1)[1]
    path.write_text(f"{before}{MARKS[0]}\n{text}\n{MARKS[1]}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
