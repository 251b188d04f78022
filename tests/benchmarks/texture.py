"""Quality of textures against photos left out.

    python tests/benchmarks/texture.py chapel FOLDER      a painted chapel, 24 photos, 6 left out
    python tests/benchmarks/texture.py poses FOLDER       one photo in ten posed wrong by one degree
    python tests/benchmarks/texture.py strangers FOLDER   a stranger in a fifth of the photos
    python tests/benchmarks/texture.py fountain           ../shared/data/fountain-P11, 0003 and 0007 left out

FOLDER keeps the chapel's photos, which take some minutes to render, and the pictures to look at.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from fresco.core.cameras import PerspectiveCamera
from fresco.core.geometry.meshes import face_normals
from fresco.core.geometry.rigid import exp_so3
from fresco.core.jobs import drain
from fresco.core.photos import View, read_image
from fresco.core.settings import TextureSettings
from fresco.core.texture import level_seams, select_views
from fresco.core.texture.models.render import shade_textured_job, trace_pixels_job
from fresco.core.texture.quality import compare_images

sys.path.insert(0, str(Path(__file__).parent))
from texture_chapel import chapel_mesh, chapel_views

FOUNTAIN = Path(__file__).parents[3] / "shared" / "data" / "fountain-P11"
HEAD = (
    "| setting | PSNR | gain-fitted | SSIM | offset px | coverage | seams m | seam step | CPU s |\n"
    + "|---" * 9
    + "|"
)


SHOWN = 3
"""Trials with wrong poses of which the texture is compared as well."""


class Judge:
    """Re-renders held-out photos; the rays of the pixels are cast once."""

    def __init__(self, mesh, held, pictures: Path) -> None:
        self.mesh, self.held, self.pictures = mesh, held, pictures
        self.area = face_normals(*mesh)[1]
        self.hits = [drain(trace_pixels_job(v.camera, v.rotation, v.translation, *mesh)) for v in held]
        self.photos = [read_image(v.image) for v in held]

    def row(self, name: str, views, settings: TextureSettings) -> str:
        """One line of the table for one way of choosing photos."""
        start = time.process_time()
        selection = select_views(*self.mesh, views, settings)
        cpu = time.process_time() - start
        agreements = []
        error = pixels = 0.0
        for view, hits, photo in zip(self.held, self.hits, self.photos, strict=True):
            picture = drain(shade_textured_job(hits, *self.mesh, selection, views))
            agreements.append(compare_images(picture.image, photo, picture.covered))
            difference = picture.image[picture.covered].astype(float) - photo[picture.covered]
            error, pixels = error + np.sum(difference**2), pixels + difference.size
            both = np.concatenate([picture.image, photo], axis=1)
            cv2.imwrite(str(self.pictures / f"{name}-{Path(view.name).stem}.png"), both[..., ::-1])
        levels = level_seams(*self.mesh, selection, views)
        fitted = -10 * np.log10(np.mean([10 ** (-a.gain_fitted_psnr / 10) for a in agreements]))
        offset = np.median([np.hypot(*a.offset) for a in agreements])
        coverage = 100 * self.area[selection.view >= 0].sum() / self.area.sum()
        return (
            f"| {name} | {10 * np.log10(255**2 * pixels / error):.2f} | {fitted:.2f} "
            f"| {np.mean([a.ssim for a in agreements]):.4f} | {offset:.3f} | {coverage:.1f} % "
            f"| {levels.length:.0f} | {levels.before:.1f} | {cpu:.1f} |"
        )


def chapel(folder: Path) -> None:
    mesh = chapel_mesh()
    used, held = chapel_views(folder, mesh)
    judge = Judge(mesh, held, folder)
    usual = TextureSettings()
    print(HEAD)
    for name, settings in {
        "default": usual,
        "each face its best": replace(usual, smoothness=0.0),
        "published score": replace(usual, score="published"),
        "without sharpness": replace(usual, sharpness="off"),
        "without gains": replace(usual, equalise=False),
    }.items():
        print(judge.row(name, used, settings), flush=True)


def poses(folder: Path, trials: int = 8) -> None:
    """Turn 2 or 3 of 24 photos by one degree about random axes; count who is named, show what they spoil."""
    mesh = chapel_mesh()
    used, held = chapel_views(folder, mesh)
    judge = Judge(mesh, held, folder)
    random = np.random.default_rng(0)
    named = wrong = false = right = 0
    for trial in range(trials):
        bad = random.choice(len(used), 2 + trial % 2, replace=False)
        views = list(used)
        for number in bad:
            axis = random.normal(size=3)
            turn = exp_so3(np.radians(1.0) * axis / np.linalg.norm(axis)) @ used[number].rotation
            views[number] = replace(used[number], rotation=turn, translation=-turn @ used[number].centre)
        selection = select_views(*mesh, views, TextureSettings(smoothness=0))
        out = np.flatnonzero(selection.left_out)
        named, false = named + len(np.intersect1d(out, bad)), false + len(np.setdiff1d(out, bad))
        wrong, right = wrong + len(bad), right + len(used) - len(bad)
        missed = np.setdiff1d(bad, out)
        note = [(used[n].name, round(float(selection.pose_shift[n]), 1)) for n in missed]
        print(f"trial {trial}: turned {len(bad)}, named {len(bad) - len(missed)}, missed {note}", flush=True)
        if trial < SHOWN:
            without = [view for number, view in enumerate(used) if number not in bad]
            rows = [
                judge.row(f"trial {trial}, {name}", photos, TextureSettings())
                for name, photos in (("turned", views), ("without them", without))
            ]
            print("\n".join([HEAD, *rows]), flush=True)
    print(f"named {named} of {wrong} photos turned by 1 degree; {false} of {right} right ones named too")


def strangers(folder: Path) -> None:
    """Paint a dark figure into every fifth photo; compare the texture with that of the clean photos."""
    mesh = chapel_mesh()
    used, held = chapel_views(folder, mesh)
    judge = Judge(mesh, held, folder)
    views = []
    for number, view in enumerate(used):
        image = read_image(view.image)
        if number % 5 == 0:
            centre = 500 + 90 * number % 600, 600
            for offset, axes in (((0, 0), (90, 210)), ((0, -260), (50, 60))):
                at = centre[0] + offset[0], centre[1] + offset[1]
                cv2.ellipse(image, at, axes, 0, 0, 360, (46, 38, 70), -1, cv2.LINE_AA)
        views.append(replace(view, image=image))
    print(HEAD)
    print(judge.row("clean", used, TextureSettings()), flush=True)
    print(judge.row("strangers kept", views, TextureSettings(reject_foreign=False)), flush=True)
    print(judge.row("strangers rejected", views, TextureSettings()), flush=True)


def fountain(_: Path) -> None:
    import trimesh

    scan = trimesh.load(FOUNTAIN / "mesh.ply", process=False)
    views = []
    for entry in json.loads((FOUNTAIN / "cameras.json").read_text())["cameras"]:
        camera = PerspectiveCamera(entry["width"], entry["height"], entry["K"])
        image = FOUNTAIN / "images" / entry["image"]
        views.append(View(camera, np.array(entry["R"]), np.array(entry["t"]), image, entry["image"]))
    held = [view for view in views if view.name[:4] in ("0003", "0007")]
    used = [view for view in views if view not in held]
    pictures = Path(tempfile.gettempdir()) / "fresco-fountain"
    pictures.mkdir(exist_ok=True)
    judge = Judge((np.asarray(scan.vertices, float), np.asarray(scan.faces, np.int32)), held, pictures)
    print(HEAD)
    print(judge.row("fountain-P11", used, TextureSettings()), flush=True)
    print(judge.row("fountain-P11, without gains", used, TextureSettings(equalise=False)), flush=True)


if __name__ == "__main__":
    task = {"chapel": chapel, "poses": poses, "strangers": strangers, "fountain": fountain}[sys.argv[1]]
    task(Path(sys.argv[2]) if len(sys.argv) > 2 else Path())
