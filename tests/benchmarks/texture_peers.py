"""Fresco's texture beside other programs': same mesh, same photos, same renderer, one run.

    python tests/benchmarks/texture_peers.py FOLDER [PYTHON]

The painted chapel with pinhole cameras (which all of them understand) is photographed into FOLDER. PYTHON is
an interpreter that has pymeshlab, open3d and pycolmap; what it lacks is left out, with the reason. Every
program runs in a process of its own, whose CPU time and peak memory the system tells. Textures are shown by
the renderer that shows ours, at the offset (half a texel either way, or none) that suits them best.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import cv2
import numpy as np
from fresco.core.geometry.meshes import face_normals
from fresco.core.jobs import drain
from fresco.core.photos import View, read_image
from fresco.core.texture.models.render import shade_textured_job, trace_pixels_job
from fresco.core.texture.quality import compare_images
from fresco.core.texture.views.visibility import triangle_areas

sys.path.insert(0, str(Path(__file__).parent))
from texture_chapel import chapel_mesh, chapel_views

PROGRAM = Path(__file__).parent / "texture_peer.py"
ROWS = {
    "Fresco, originals": ("fresco", sys.executable),
    "Fresco, atlas": ("fresco-atlas", sys.executable),
    "MeshLab, colour-corrected": ("meshlab", None),
    "MeshLab, projected": ("meshlab-projected", None),
    "COLMAP mesh texturer": ("colmap", None),
    "Open3D albedo": ("open3d", None),
}
HEAD = "| program | CPU s | peak MB | PSNR | SSIM | coverage | texel offset |\n" + "|---" * 7 + "|"


@dataclass(frozen=True)
class Run:
    """What a program's process took, and why it failed, if it did."""

    cpu: float
    megabytes: float
    error: str


@dataclass(frozen=True)
class Textured:
    """A textured mesh as `shade_textured_job` takes it."""

    view: np.ndarray
    uv: np.ndarray
    gain: np.ndarray


def write_scene(folder: Path, mesh, used) -> None:
    """Write what every program is given: mesh, photos by name, cameras."""
    cameras = {
        "K": np.array([view.camera.K for view in used]),
        "R": np.array([view.rotation for view in used]),
        "t": np.array([view.translation for view in used]),
        "image": np.array([str(view.image) for view in used]),
    }
    np.savez(folder / "scene.npz", vertices=mesh[0], faces=mesh[1], **cameras)


def run(program: str, python: str, folder: Path) -> Run:
    """Run one program in its own process."""
    log = folder / f"{program}.log"
    with log.open("wb") as out:
        command = [python, str(PROGRAM), program, str(folder)]
        process = os.posix_spawn(
            python,
            command,
            os.environ,
            file_actions=[(os.POSIX_SPAWN_DUP2, out.fileno(), fd) for fd in (1, 2)],
        )
        _, status, usage = os.wait4(process, 0)
    cpu, megabytes = usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
    lines = log.read_text(errors="replace").strip().splitlines()
    error = ""
    if status:
        message = lines[-1] if lines else "no message"
        error = f"{message} ({cpu:.0f} CPU s, {megabytes:.0f} MB)"
    return Run(cpu, megabytes, error)


def read_result(folder: Path, program: str, used) -> tuple[Textured, list[View]]:
    """Read the textured mesh that a program wrote."""
    result = np.load(folder / f"{program}.npz")
    if "view" in result:
        return Textured(result["view"], result["uv"], result["gain"]), used
    pages = [cv2.imread(str(folder / name)) for name in result["pages"].tolist()]
    views = []
    for page, image in zip(result["pages"].tolist(), pages, strict=True):
        camera = replace_size(used[0].camera, image.shape[1], image.shape[0])
        views.append(View(camera, used[0].rotation, used[0].translation, folder / page))
    size = np.array([(image.shape[1], image.shape[0]) for image in pages])[result["page"]][:, None]
    uv = result["uv"] * (1, -1) + (0, 1)
    uv = uv * size - 0.5
    textured = np.where(triangle_areas(uv) > 1e-3, result["page"], -1).astype(np.int32)
    return Textured(textured, uv, np.ones((len(pages), 3))), views


def replace_size(camera, width: int, height: int):
    """Return a camera of the size of a page: the renderer checks it."""
    return type(camera)(width, height, camera.K)


class Judge:
    """Shows results from where the photos left out were taken."""

    def __init__(self, mesh, held, common) -> None:
        self.mesh, self.held, self.common = mesh, held, common
        self.hits = [drain(trace_pixels_job(v.camera, v.rotation, v.translation, *mesh)) for v in held]
        self.photos = [read_image(view.image) for view in held]

    def agreement(self, textured: Textured, views, some: int) -> tuple[float, float]:
        """PSNR over all pixels that the result and ours cover, and mean SSIM."""
        error = pixels = 0.0
        ssim = []
        for hits, photo in list(zip(self.hits, self.photos, strict=True))[:some]:
            picture = drain(shade_textured_job(hits, *self.mesh, textured, views))
            covered = picture.covered & self.common[hits.face]
            difference = picture.image[covered].astype(float) - photo[covered]
            error, pixels = error + np.sum(difference**2), pixels + difference.size
            ssim.append(compare_images(picture.image, photo, covered).ssim)
        return float(10 * np.log10(255**2 * pixels / error)), float(np.mean(ssim))

    def row(self, name: str, took: Run, textured: Textured, views, shifts) -> str:
        """One line of the table."""
        tried = {
            shift: self.agreement(replace(textured, uv=textured.uv + shift), views, 2)[0] for shift in shifts
        }
        best = max(tried, key=tried.get)
        psnr, ssim = self.agreement(replace(textured, uv=textured.uv + best), views, len(self.held))
        area = face_normals(*self.mesh)[1]
        coverage = 100 * area[textured.view >= 0].sum() / area.sum()
        return (
            f"| {name} | {took.cpu:.1f} | {took.megabytes:.0f} | {psnr:.2f} | {ssim:.4f} | {coverage:.1f} % "
            f"| {best[0]:g}, {best[1]:g} |"
        )


def main(folder: Path, python: str) -> None:
    mesh = chapel_mesh()
    used, held = chapel_views(folder, mesh, pinhole=True)
    write_scene(folder, mesh, used)
    judge = None
    print(HEAD)
    for name, (program, own) in ROWS.items():
        took = run(program, own or python, folder)
        if took.error:
            print(f"| {name} | left out: {took.error} |", flush=True)
            continue
        textured, views = read_result(folder, program, used)
        judge = judge or Judge(mesh, held, textured.view >= 0)
        shifts = [(0.0, 0.0)] if own else list(product((-0.5, 0.0, 0.5), repeat=2))
        print(judge.row(name, took, textured, views, shifts), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), sys.argv[2] if len(sys.argv) > 2 else sys.executable)
