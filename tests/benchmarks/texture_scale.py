"""Time and memory of choosing photos.

python tests/benchmarks/texture_scale.py MILLIONS_OF_FACES PHOTOS [MEMORY_LIMIT_GIB]
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from fresco.core.jobs import drain
from fresco.core.settings import TextureSettings
from fresco.core.texture import select_views_job, split_large_faces_job
from fresco.core.texture.obj import write_obj

sys.path.insert(0, str(Path(__file__).parent))
from texture_chapel import chapel_mesh, painted_tile, random_poses

SIZE = (6000, 4000)


def main(millions: float, photos: int, memory_limit: float = 0.0) -> None:
    mesh = chapel_mesh(0.067 * np.sqrt(0.2162 / millions))
    with tempfile.TemporaryDirectory() as folder:
        photo = Path(folder) / "photo.jpg"
        tile = cv2.resize(painted_tile(), SIZE, interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(photo), tile, [cv2.IMWRITE_JPEG_QUALITY, 90])
        views = []
        for number, pose in enumerate(random_poses(np.random.default_rng(3), photos, SIZE)):
            copy = photo.with_name(f"photo{number:03d}.jpg")
            copy.symlink_to(photo)
            views.append(replace(pose, image=copy, name=copy.name))
        print(
            f"{len(mesh[1])} faces, {photos} photos of {SIZE[0]} x {SIZE[1]}, {photo.stat().st_size >> 20} MB"
        )
        run(mesh, views, TextureSettings(memory_limit=memory_limit), Path(folder))


def run(mesh, views, settings: TextureSettings, folder: Path) -> None:
    start, start_cpu = time.perf_counter(), time.process_time()
    split = drain(split_large_faces_job(*mesh, views, settings.uv_tolerance))
    wall, cpu = time.perf_counter() - start, time.process_time() - start_cpu
    print(f"split_large_faces: {wall:.1f} s wall, {cpu:.1f} s CPU, {len(split.faces)} faces")
    mesh = split.vertices, split.faces
    stages: dict[str, list[float]] = {}
    last = [time.perf_counter(), time.process_time(), ""]

    def account(progress) -> None:
        now, cpu = time.perf_counter(), time.process_time()
        if last[2]:
            wall_cpu = stages.setdefault(last[2], [0.0, 0.0])
            wall_cpu[0] += now - last[0]
            wall_cpu[1] += cpu - last[1]
        last[:] = [now, cpu, progress.message.split(" photo")[0]]

    start, start_cpu = time.perf_counter(), time.process_time()
    selection = drain(select_views_job(*mesh, views, settings), account)
    wall, cpu = time.perf_counter() - start, time.process_time() - start_cpu
    for name, (stage_wall, stage_cpu) in stages.items():
        print(f"  {name:45s} {stage_wall:7.1f} s wall {stage_cpu:7.1f} s CPU")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"select_views: {wall:.1f} s wall, {cpu:.1f} s CPU, peak {peak:.2f} GiB")
    print(f"  faces seen {np.mean(selection.view >= 0):.3f}, photos left out {int(selection.left_out.sum())}")
    start = time.perf_counter()
    write_obj(folder / "model.obj", *mesh, selection, views)
    print(f"write_obj: {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main(float(sys.argv[1]), int(sys.argv[2]), *(float(limit) for limit in sys.argv[3:4]))
