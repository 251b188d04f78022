"""Leave photos out of texturing and compare the textured model, seen from where they stood, with them.

    python tests/benchmarks/held_out.py tests/fountain/project.toml 0003 0007
    python tests/benchmarks/held_out.py tests/fountain/project.toml 0003 0007 --cameras .../cameras.json

Poses are solved from the regions, those of the photos left out too; with --cameras (a file like that of
fountain-P11) they are taken from there, so that the figures tell of the texture alone. Every photo left out
is written with its rendering beside it.
"""

import argparse
import dataclasses
import json
import tempfile
from pathlib import Path

import cv2
import numpy as np
from fresco.core.jobs import drain
from fresco.core.photos import read_image
from fresco.core.project import load_project, run_project_job
from fresco.core.texture.models.render import render_view
from fresco.core.texture.quality import compare_images


def main():
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("project", type=Path)
    options.add_argument("photos", nargs="+", help="names of the photos to leave out")
    options.add_argument("--cameras", type=Path, help="known poses of all photos")
    options.add_argument("--pictures", type=Path, default=Path(tempfile.gettempdir()) / "fresco-held-out")
    chosen = options.parse_args()
    project = without(load_project(chosen.project), chosen.photos, known_poses(chosen.cameras))
    result = drain(run_project_job(project))
    stages = ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in result.seconds.items())
    print(f"{stages}; coverage {100 * result.textured.coverage:.1f} % of the surface")
    print("| photo | PSNR | gain-fitted | SSIM | offset u, v (px) | covered |\n|---|---|---|---|---|---|")
    for name in chosen.photos:
        print(compare(result, name, chosen.pictures))


def known_poses(path):
    """Rotation and translation by photo name; empty without a file."""
    if path is None:
        return {}
    cameras = json.loads(path.read_text(encoding="utf-8"))["cameras"]
    return {Path(c["image"]).stem: (np.array(c["R"]), np.array(c["t"])) for c in cameras}


def without(project, names, poses):
    """Return the project with photos left out of texturing and known poses put in; output is thrown away."""
    photos = tuple(
        dataclasses.replace(
            entry,
            use="pose" if entry.photo.name in names else entry.use,
            pose=poses.get(entry.photo.name, entry.pose),
        )
        for entry in project.photos
    )
    scratch = dataclasses.replace(project.output, folder=Path(tempfile.mkdtemp()), obj=False)
    return dataclasses.replace(project, photos=photos, output=scratch)


def compare(result, name, pictures):
    """One row of the table; writes photo and rendering side by side."""
    number = [photo.name for photo in result.photos].index(name)
    photo, pose = result.photos[number], result.poses[number].pose
    textured = result.textured
    rendering = render_view(
        photo.camera,
        pose.rotation,
        pose.translation,
        textured.vertices,
        textured.faces,
        textured.selection,
        textured.views,
    )
    original = read_image(photo.path)
    found = compare_images(rendering.image, original, rendering.covered)
    pictures.mkdir(parents=True, exist_ok=True)
    beside = np.hstack([original, rendering.image])[:, :, ::-1]
    (pictures / f"{name}.jpg").write_bytes(cv2.imencode(".jpg", beside)[1].tobytes())
    u, v = found.offset
    return (
        f"| {name} | {found.psnr:.2f} | {found.gain_fitted_psnr:.2f} | {found.ssim:.3f} "
        f"| {u:.2f}, {v:.2f} | {100 * found.coverage:.0f} % |"
    )


if __name__ == "__main__":
    main()
