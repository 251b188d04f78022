"""Run the sample project, show the cameras' errors against the truth, re-render photos left out of texturing.

python tests/benchmarks/sample.py [--report report.html] [--picture sample.jpg] [--held-out] [--true-poses]
"""

import argparse
import dataclasses
import json
import resource
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from fresco.core.jobs import drain
from fresco.core.project.file.load import load_project
from fresco.core.project.run import run_project
from fresco.core.project.stages.textures import texture_scan_job
from fresco.core.report import project_report, write_report
from fresco.core.report.content import photo_rows
from fresco.core.report.viewpoint import two_viewpoints
from fresco.core.texture.models.render import (
    render_view,
    shade_clay,
    shade_textured_job,
    trace_pixels_job,
)
from fresco.core.texture.quality import compare_images
from fresco.core.texture.views.images import read_photo

SAMPLE = Path(__file__).resolve().parents[2] / "sample"


def main():
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--sample", type=Path, default=SAMPLE)
    options.add_argument("--report", type=Path, help="also write the report, with the errors in it")
    options.add_argument("--picture", type=Path, help="also save photo, scan and textured scan side by side")
    options.add_argument(
        "--held-out", action="store_true", help="texture without each photo, compare with it"
    )
    options.add_argument(
        "--true-poses", action="store_true", help="use the true poses: measures texture alone"
    )
    chosen = options.parse_args()
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        truth = read_truth(chosen.sample / "truth.json")
        result = run(chosen.sample, Path(folder), truth if chosen.true_poses else {})
    report = project_report(result, truth)
    unrefined = [dataclasses.replace(p, pose=p.first_pose, refinements=()) for p in result.poses]
    if any(pose.refinements for pose in result.poses):
        print("from regions alone:")
        print_poses(photo_rows(dataclasses.replace(report, poses=unrefined)))
        print("refined:")
    print_poses(photo_rows(report))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{time.perf_counter() - start:.1f} s, peak {peak:.0f} MiB, "
        f"coverage {100 * result.textured.coverage:.1f} %"
    )
    if chosen.report:
        print(write_report(report, chosen.report))
    if chosen.picture:
        save_picture(result, chosen.picture)
    if chosen.held_out:
        print_held_out(result)


def run(sample, folder, given_poses):
    project = load_project(sample / "project.toml")
    output = dataclasses.replace(project.output, folder=folder)
    photos = tuple(
        dataclasses.replace(entry, pose=given_poses.get(entry.photo.name)) for entry in project.photos
    )
    return run_project(dataclasses.replace(project, output=output, photos=photos))


def read_truth(path):
    """Known poses by photo name: rotation (3,3), translation (3,), world to camera."""
    poses = json.loads(path.read_text(encoding="utf-8"))
    return {
        Path(name).stem: (np.array(pose["rotation"]), np.array(pose["translation"]))
        for name, pose in poses.items()
    }


def print_poses(rows):
    print(f"{'photo':18} {'regions':32} {'overlap %':>9} {'rot °':>7} {'σ':>6} {'centre mm':>9} {'σ':>6}")
    for row in rows:
        if row.overlap_error is None:
            print(f"{row.name:18} {row.status}: {row.failure}")
            continue
        print(
            f"{row.name:18} {' '.join(row.regions):32} {row.overlap_error:9.2f} {row.rotation_error:7.3f} "
            f"{row.rotation_sigma:6.3f} {row.centre_error:9.1f} {row.centre_sigma:6.1f}"
        )
    known = [row for row in rows if row.overlap_error is not None]
    if not known:
        return
    rotation, centre = (
        np.median([getattr(row, name) for row in known]) for name in ("rotation_error", "centre_error")
    )
    print(f"{len(known)} of {len(rows)} solved, median {rotation:.3f}°, {centre:.1f} mm")


def print_held_out(result):
    """Texture without each photo in turn and compare the rendering with it, at its solved pose."""
    print(f"{'held out':18} {'PSNR':>6} {'gain-fitted':>11} {'SSIM':>6} {'shift px':>16} {'covered':>8}")
    for number, held_out in enumerate(result.textured.views):
        others = [view for i, view in enumerate(result.textured.views) if i != number]
        textured = drain(texture_scan_job(result.scan, others, result.project.texture))
        rendering = render_view(
            held_out.camera, held_out.rotation, held_out.translation,
            textured.vertices, textured.faces, textured.selection, others,
        )  # fmt: skip
        found = compare_images(rendering.image, read_photo(held_out), rendering.covered)
        du, dv = found.offset
        print(
            f"{held_out.name:18} {found.psnr:6.2f} {found.gain_fitted_psnr:11.2f} {found.ssim:6.3f} "
            f"{du:8.2f}{dv:8.2f} {100 * found.coverage:7.1f}%"
        )


def save_picture(result, path, height=520):
    """A photo, the scan and the textured scan beside each other, with a narrow white gap."""
    textured = result.textured
    shown = textured.faces[textured.selection.view >= 0]
    viewpoint = two_viewpoints(textured.vertices, shown, textured.views)[1]
    pose = viewpoint.camera, viewpoint.rotation, viewpoint.translation
    hits = drain(trace_pixels_job(*pose, textured.vertices, textured.faces))
    scan = shade_clay(hits, textured.vertices, textured.faces)
    job = shade_textured_job(hits, textured.vertices, textured.faces, textured.selection, textured.views)
    pictures = [read_photo(textured.views[0]), scan, drain(job).image]
    widths = [round(height * picture.shape[1] / picture.shape[0]) for picture in pictures]
    small = [
        cv2.resize(p, (w, height), interpolation=cv2.INTER_AREA)
        for p, w in zip(pictures, widths, strict=True)
    ]
    gap = np.full((height, 8, 3), 255, np.uint8)
    row = np.concatenate([small[0], gap, small[1], gap, small[2]], axis=1)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(cv2.imencode(".jpg", row[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 84])[1].tobytes())
    print(path)


if __name__ == "__main__":
    main()
