"""Time per stage and memory of a whole project with posed photos, from the scan's file to the .blend.

python tests/benchmarks/project_scale.py [MILLIONS OF FACES] [PHOTOS]
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import trimesh
from fresco.addon.cli import _start_blender, run_job
from fresco.core.jobs import Progress, drain
from fresco.core.photos import View
from fresco.core.project import load_project

sys.path.insert(0, str(Path(__file__).parent))
from texture_chapel import chapel_mesh, painted_tile, random_poses

SIZE = (6000, 4000)


def main(millions: float, photos: int) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        vertices, faces = chapel_mesh(0.067 * np.sqrt(0.2162 / millions))
        trimesh.Trimesh(vertices, faces, process=False).export(folder / "scan.ply")
        views = random_poses(np.random.default_rng(3), photos, SIZE)
        write_photos(folder, views)
        (folder / "project.toml").write_text("\n".join(project_lines(views)))
        print(f"{len(faces)} faces, {photos} photos of {SIZE[0]} x {SIZE[1]}")
        stages = run(folder / "project.toml")
    for stage, seconds in sorted(stages.items(), key=lambda item: -item[1]):
        print(f"  {stage:40s} {seconds:7.1f} s")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"whole run {sum(stages.values()):.1f} s, peak {peak:.2f} GiB")


def write_photos(folder: Path, views: list[View]) -> None:
    """Write one picture, under the name of every photo."""
    tile = cv2.resize(painted_tile(), SIZE, interpolation=cv2.INTER_AREA)
    picture = cv2.imencode(".jpg", tile, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
    for number in range(len(views)):
        (folder / f"photo{number:03d}.jpg").write_bytes(picture)


def project_lines(views: list[View]) -> Iterator[str]:
    yield 'fresco = 1\n[scan]\npath = "scan.ply"'
    for number, view in enumerate(views):
        camera = view.camera
        yield f'[[camera]]\nname = "{number}"\nK = {camera.K.tolist()}'
        yield f"distortion = {np.asarray(camera.distortion.opencv).tolist()}"
        yield f'[[photo]]\npath = "photo{number:03d}.jpg"\ncamera = "{number}"'
        yield f"pose = {{ rotation = {view.rotation.tolist()}, translation = {view.translation.tolist()} }}"
    yield "[output]\nblend = true\nobj = true\nglb = false\nreport = false"


def run(path: Path) -> dict[str, float]:
    """Return the wall seconds of each kind of step, named by its message without the photo's name."""
    project = load_project(path)
    _start_blender()
    stages: dict[str, float] = {}
    last = [time.perf_counter(), "Reading the scan"]

    def account(progress: Progress) -> None:
        now = time.perf_counter()
        stages[last[1]] = stages.get(last[1], 0.0) + now - last[0]
        words = progress.message.split()
        last[:] = [now, " ".join(w for w in words if not w.startswith("photo") and not w[0].isdigit())]

    drain(run_job(project), account)
    account(Progress(1.0, "end"))
    return stages


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 1.0, int(sys.argv[2]) if len(sys.argv) > 2 else 24)
    sys.stdout.flush()
    os._exit(0)  # Blender's module does not end by itself while an add-on is registered
