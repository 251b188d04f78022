"""Benchmark of pose refinement: `python tests/benchmarks/refine.py [TABLE ...] [--quick] [--write]`.

Disturbs known poses and measures what each kind of refinement gives back: `points` against OpenCV's
refinement with the true points as the bound, `edges` on rendered scenes, `real` on a folder like
fountain-P11, `regions` there from the poses that its regions give (all tables when none is named).
`--write` puts them into docs/benchmarks.md.
"""

import argparse
import json
import os
import sys
import tempfile
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
from fresco.core.pose.edges import refine_pose_on_scan_job
from fresco.core.pose.edges.rendering import EdgeScan
from fresco.core.pose.joint.similarity import umeyama
from fresco.core.project import load_project, run_project
from fresco.core.project.stages.refinement import RefineSettings
from fresco.core.scans import read_scan_job
from fresco.core.settings import EdgeSettings, JointSettings
from refine_scenes import scene_views
from scipy.stats import chi2

ROOT = Path(__file__).resolve().parents[2]

DISTURBED = ((0.01, 0.001), (0.2, 0.02), (0.5, 0.05), (1.0, 0.1), (2.0, 0.2))
"""Degrees and metres by which starts of edge refinement are off; the first shows what is left at best."""


def main():
    tables = {"points": points_table, "edges": edges_table, "real": real_table, "regions": regions_table}
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument(
        "tables", nargs="*", help="which tables: points, edges, real, regions; all by default"
    )
    options.add_argument("--quick", action="store_true", help="fewer cases")
    options.add_argument("--write", action="store_true", help="put the tables into docs/benchmarks.md")
    options.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data" / "fountain-P11")
    chosen = options.parse_args()
    for name in chosen.tables or tables:
        text = tables[name](chosen)
        print(text)
        if chosen.write and text:
            write_section(ROOT / "docs" / "benchmarks.md", name, text)


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


def points_table(options):
    """Poses from 12 points with 0.7 px noise, a third of them wrong, beside OpenCV told which are right."""
    cases = 50 if options.quick else 300
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


def edges_table(options):
    """Edge refinement of disturbed poses on rendered scenes; without covariance, as the start comes."""
    cases, lines = 1 if options.quick else 3, []
    scenes = scene_views()
    for degrees, metres in DISTURBED:
        rng = np.random.default_rng(1)
        for name, (scene, views) in scenes.items():
            seconds = time.process_time()
            starts = [(disturbed(view, degrees, metres, rng), view) for view in views for _ in range(cases)]
            poses = [refine_pose_by_edges(start, scene.vertices, scene.faces) for start, _ in starts]
            seconds = (time.process_time() - seconds) / len(starts)
            bound = np.median([opencv_errors(*start, scene, rng) for start in starts], axis=0)
            told = np.array([errors(pose, view) for pose, (_, view) in zip(poses, starts, strict=True)])
            moved = np.array([pose.refined for pose in poses])
            label = f"{degrees}°, {100 * metres:g} cm | {name}"
            lines.append(edges_line(label, told, moved, metres, bound, seconds))
            print(lines[-1], file=sys.stderr, flush=True)
    head = (
        f"Edge refinement of disturbed poses on rendered scenes ({2 * cases} cases a row; 1080 x 810 pixels, "
        "2 to 7 m away), scan without colour, the start without covariance; “back” is within 0.15° and "
        "15 mm; “worse” is farther away than the start (but for the first rows, which start at the truth "
        "to show what the edges themselves are off by), “wrong” is beyond the stated covariance (1 in "
        "1000), both of those moved and not said so. The bound is `cv2.solvePnPRefineLM` from the same "
        "start with 40 true points and 0.5 px noise:\n\n"
        "| disturbed by | scene | back | kept, said so | worse, wrong | moved ones, median "
        "| normalised error² (mean, ideal 6) | bound | CPU s |\n|---|---|---|---|---|---|---|---|---|\n"
    )
    return head + "\n".join(lines)


def edges_line(label, told, moved, metres, bound, seconds):
    """One row of the table of edges, from errors (N,3) as `errors` gives them."""
    back = moved & (told[:, 0] < 0.15) & (told[:, 1] < 0.015)
    worse = moved & (told[:, 1] > metres) & (metres > 0.001)
    wrong = moved & (told[:, 2] > chi2.ppf(0.999, 6))
    angle, centre = np.median(told[moved, :2], axis=0) if moved.any() else (np.nan, np.nan)
    nees = told[moved, 2].mean() if moved.any() else np.nan
    return (
        f"| {label} | {np.mean(back):.0%} | {np.mean(~moved):.0%} "
        f"| {worse.sum()}, {wrong.sum()} of {len(told)} | {angle:.3f}°, {1000 * centre:.1f} mm | {nees:.1f} "
        f"| {bound[0]:.3f}°, {1000 * bound[1]:.1f} mm | {seconds:.1f} |"
    )


def opencv_errors(start, view, scene, rng):
    """Rotation (degrees) and centre (m) error of OpenCV's refinement with true points."""
    points = scene.vertices[rng.choice(len(scene.vertices), 4000, replace=False)]
    pixels = view.camera.project(points @ view.rotation.T + view.translation)
    seen = np.flatnonzero(np.isfinite(pixels).all(axis=1) & view.camera.in_frame(pixels))[:40]
    noisy = pixels[seen] + rng.normal(0, 0.5, (len(seen), 2))
    vector, translation = cv2.Rodrigues(start.rotation)[0], start.translation.reshape(3, 1).copy()
    vector, translation = cv2.solvePnPRefineLM(points[seen], noisy, view.camera.K, None, vector, translation)
    found = cv2.Rodrigues(vector)[0]
    shift = np.linalg.norm(-found.T @ translation.ravel() - view.centre)
    return np.degrees(rotation_angle(found @ view.rotation.T)), shift


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


def real_table(options):
    """Per photo: start like a region pose (0.16 degrees, 2 cm), after edges, after all photos together."""
    folder = options.data
    if not folder.exists():
        print(f"{folder} is not there: no real photos", file=sys.stderr)
        return ""
    views = real_views(folder)
    scan = drain(read_scan_job(folder / "mesh.ply"))
    vertices, faces = scan.vertices + scan.offset, scan.faces
    starts, seconds = [], []
    for seed in range(1 if options.quick else 2):
        rng = np.random.default_rng(seed)
        starts.append([disturbed(view, 0.16, 0.02, rng) for view in views])
    clock = time.process_time()
    sigma = np.repeat([np.radians(0.16), 0.02], 3) / np.sqrt(3)
    prepared = EdgeScan.centred(vertices, faces)
    rough = [[replace(start, covariance=np.diag(sigma**2)) for start in draw] for draw in starts]
    edges = [[drain(refine_pose_on_scan_job(start, prepared)) for start in draw] for draw in rough]
    seconds.append((time.process_time() - clock) / len(starts) / len(views))
    kept = sum(not pose.refined for draw in edges for pose in draw)
    clock = time.process_time()
    joint = refine_poses_jointly(starts[0], vertices, faces)
    seconds.append(time.process_time() - clock)
    edges = np.array([[errors(p, v) for p, v in zip(draw, views, strict=True)] for draw in edges])
    tied = np.array([errors(p, v) for p, v in zip(joint, views, strict=True)])
    shape = np.array(shape_errors(joint, views))
    lines = [
        f"{folder.name} from poses disturbed like region poses (0.16°, 20 mm; {len(starts)} draws by edges "
        f"with the covariance that region poses have, one together without), scan without colour; "
        f"{seconds[0]:.1f} CPU s per photo by edges ({kept} of "
        f"{edges[..., 0].size} starts kept, and said so), {seconds[1]:.0f} CPU s for all together. “Shape” "
        "is what is left of the joint solution after the best similarity onto the published centres:\n",
        "| photo | edges alone | all photos together | shape |",
        "|---|---|---|---|",
    ]
    by_photo = np.median(edges, axis=0)
    for view, e, j, k in zip(views, by_photo, tied, shape, strict=True):
        lines.append(
            f"| {view.name} | {e[0]:.3f}°, {1000 * e[1]:.1f} mm | {j[0]:.3f}°, {1000 * j[1]:.1f} mm | "
            f"{k[0]:.3f}°, {1000 * k[1]:.1f} mm |"
        )
    e, j, k = np.median(edges.reshape(-1, 3), axis=0), np.median(tied, axis=0), np.median(shape, axis=0)
    lines.append(
        f"| median | {e[0]:.3f}°, {1000 * e[1]:.1f} mm | {j[0]:.3f}°, {1000 * j[1]:.1f} mm | "
        f"{k[0]:.3f}°, {1000 * k[1]:.1f} mm |\n"
        f"| normalised error² (ideal 6) | {e[2]:.1f} | {j[2]:.1f} | |"
    )
    return "\n".join(lines)


def regions_table(options):
    """Per photo: the pose that its regions give, after edges, after all photos together."""
    truth = {Path(view.name).stem: view for view in real_views(options.data)} if options.data.exists() else {}
    project = load_project(ROOT / "tests" / "fountain" / "project.toml") if truth else None
    told = []
    for chosen in (
        RefineSettings(),
        RefineSettings(edges=EdgeSettings()),
        RefineSettings(joint=JointSettings()),
    ):
        if project is not None:
            told.append(dict(solved_errors(replace(project, refine=chosen), truth)))
    lines = [
        "The same photos from the poses that their regions give, through the project file of "
        "`tests/fountain` with one camera for all:\n",
        "| photo | regions | edges afterwards | all together afterwards |",
        "|---|---|---|---|",
    ]
    for name in told[0] if told else ():
        cells = " | ".join(f"{stage[name][0]:.3f}°, {1000 * stage[name][1]:.1f} mm" for stage in told)
        lines.append(f"| {name} | {cells} |")
    middle = [np.median(list(stage.values()), axis=0) for stage in told]
    lines.append("| median | " + " | ".join(f"{m[0]:.3f}°, {1000 * m[1]:.1f} mm" for m in middle) + " |")
    lines.append(
        "| normalised error² (median, ideal 6) | " + " | ".join(f"{m[2]:.1f}" for m in middle) + " |"
    )
    return "\n".join(lines) if told else ""


def solved_errors(project, truth):
    """Name and errors of every photo that a project gives a pose."""
    with tempfile.TemporaryDirectory() as folder:
        result = run_project(replace(project, output=replace(project.output, folder=Path(folder))))
    for found in result.poses:
        if found.solved:
            pose, centre = found.pose, found.pose.centre + result.scan.offset
            yield found.photo, errors(replace(pose, translation=-pose.rotation @ centre), truth[found.photo])


def shape_errors(poses, views):
    """Errors (degrees, m) of poses after the best similarity onto the true centres."""
    centres, true = np.array([p.centre for p in poses]), np.array([v.centre for v in views])
    scale, turn, shift = umeyama(centres, true)
    moved = scale * centres @ turn.T + shift
    return [
        (np.degrees(rotation_angle(p.rotation @ turn.T @ v.rotation.T)), np.linalg.norm(c - v.centre))
        for p, v, c in zip(poses, views, moved, strict=True)
    ]


def write_section(path, name, text):
    """Replace what stands between the marks of a table."""
    start, end = f"<!-- refine {name} -->", f"<!-- /refine {name} -->"
    page = path.read_text(encoding="utf-8")
    before, rest = page.split(start, 1)
    path.write_text(f"{before}{start}\n{text}\n{end}{rest.split(end, 1)[1]}", encoding="utf-8")


if __name__ == "__main__":
    main()
