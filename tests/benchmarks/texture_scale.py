"""Time and memory of choosing photos, and of laying the result on the scan in Blender.

python tests/benchmarks/texture_scale.py MILLIONS_OF_FACES PHOTOS [MEMORY_LIMIT_GIB]
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from fresco.addon.cli import _start_blender
from fresco.core.jobs import Progress, drain
from fresco.core.photos import View
from fresco.core.project import TexturedScan
from fresco.core.scans import Scan
from fresco.core.settings import TextureSettings
from fresco.core.texture import select_views_job, split_large_faces
from fresco.core.texture.models.obj import write_obj

sys.path.insert(0, str(Path(__file__).parent))
from texture_chapel import Mesh, chapel_mesh, painted_tile, random_poses

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


class Clock:
    """Wall and CPU seconds since it was made."""

    def __init__(self) -> None:
        self._start = time.perf_counter(), time.process_time()

    def __str__(self) -> str:
        wall, cpu = time.perf_counter() - self._start[0], time.process_time() - self._start[1]
        return f"{wall:7.1f} s wall {cpu:7.1f} s CPU"


class Stages:
    """Wall and CPU seconds of each kind of step of a job, named by its message without the photo's name."""

    def __init__(self) -> None:
        self._spent: dict[str, list[float]] = {}
        self._last = [time.perf_counter(), time.process_time()]
        self._name = ""

    def account(self, progress: Progress) -> None:
        now = [time.perf_counter(), time.process_time()]
        if self._name:
            spent = self._spent.setdefault(self._name, [0.0, 0.0])
            spent[:] = [a + b - c for a, b, c in zip(spent, now, self._last, strict=True)]
        self._last = now
        self._name = " ".join(word for word in progress.message.split() if ".jpg" not in word)

    def __str__(self) -> str:
        rows = self._spent.items()
        return "\n".join(f"  {name:38s} {wall:7.1f} s wall {cpu:7.1f} s CPU" for name, (wall, cpu) in rows)


def run(mesh: Mesh, views: list[View], settings: TextureSettings, folder: Path) -> None:
    whole, clock = Clock(), Clock()
    split = split_large_faces(*mesh, views, settings.uv_tolerance)
    print(f"split_large_faces {clock}, {len(split.faces)} faces")
    clock, stages = Clock(), Stages()
    selection = drain(select_views_job(split.vertices, split.faces, views, settings), stages.account)
    stages.account(Progress(1.0, ""))
    print(f"{stages}\nselect_views      {clock}\nboth              {whole}, peak {peak():.2f} GiB")
    print(f"  faces seen {np.mean(selection.view >= 0):.3f}, photos left out {int(selection.left_out.sum())}")
    clock = Clock()
    write_obj(folder / "model.obj", split.vertices, split.faces, selection, views)
    print(f"write_obj         {clock}")
    textured = TexturedScan(split.vertices, split.faces, split.parent, selection, tuple(views))
    show_in_blender(mesh, textured)


def show_in_blender(mesh: Mesh, textured: TexturedScan) -> None:
    """Build the scan, the photos and the texture in a new scene."""
    _start_blender()
    import bpy
    from fresco.addon.bridge import photos, scans, texture

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    vertices, faces = mesh
    numbers = np.arange(len(faces), dtype=np.int32)
    clock = Clock()
    scans.show_scan(bpy.context, Scan(vertices, faces, np.zeros(3), numbers, len(faces), "scan"), {})
    print(f"Blender: scan     {clock}")
    clock = Clock()
    for view in textured.views:
        item = photos.add_photo(bpy.context, Path(view.image), view.name)
        photos.write_camera(bpy.context, item, view.camera, "", None)
        photos.write_pose(bpy.context.scene, item, view.rotation, view.translation)
    print(f"Blender: photos   {clock}")
    clock = Clock()
    texture.show_layers(bpy.context.scene, {"": textured})
    print(f"Blender: texture  {clock}, peak {peak():.2f} GiB")


def peak() -> float:
    """Most memory that the process has had, GiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


if __name__ == "__main__":
    main(float(sys.argv[1]), int(sys.argv[2]), *(float(limit) for limit in sys.argv[3:4]))
    sys.stdout.flush()
    os._exit(0)  # Blender's module does not end by itself while an add-on is registered
