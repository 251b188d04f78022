"""Make the sample project: a painted chapel corner, scanned without colour, photographed, its regions marked.

Run from the project's root with the environment that has bpy: `.venv/bin/python sample/make_sample.py`. The
result is the same every time, up to the rounding of Cycles and its denoiser on another processor.
"""

import argparse
import json
import tempfile
from pathlib import Path

import chapel
import cv2
import marking
import numpy as np
import photography

FOLDER = Path(__file__).parent


def main():
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--output", type=Path, default=FOLDER)
    options.add_argument("--samples", type=int, default=5, help="Cycles samples per pixel")
    options.add_argument("--only", default="", help="photograph only the shots whose name contains this")
    chosen = options.parse_args()
    chosen.output.mkdir(parents=True, exist_ok=True)
    parts = chapel.parts()
    vertices, faces, labels = joined_with_labels(parts, np.random.default_rng(1))
    write_scan(chosen.output, *marking.scan(vertices, faces, labels, np.random.default_rng(2)))
    occluders = marking.Occluders(vertices, faces)
    shots = [shot for shot in photography.SHOTS if chosen.only in shot.name]
    for number, shot in enumerate(shots):
        visible = mark_regions(chosen.output, shot, number, occluders, vertices[faces].mean(axis=1), labels)
        print(f"{shot.name}: {', '.join(visible)}", flush=True)
    write_truth(chosen.output)
    if chosen.samples:
        take_photos(chosen.output, parts, shots, chosen.samples)


def joined_with_labels(parts, rng):
    """All parts as one mesh with a region number per face (0 for none)."""
    vertices, faces, labels = [], [], []
    start = 0
    for part in parts:
        vertices.append(part.vertices)
        faces.append(part.faces + start)
        start += len(part.vertices)
        if part.name in chapel.WALLS:
            wall = chapel.WALLS[part.name]
            labels.append(
                marking.face_labels(part.name, part.uv * (wall.length, wall.height), part.faces, rng)
            )
        else:
            labels.append(np.zeros(len(part.faces), np.int32))
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(labels)


def write_scan(folder, vertices, faces, labels):
    """Binary PLY without colour, and the region of every face."""
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment chapel corner, metres, z up\n"
        f"element vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(faces), dtype=[("count", "u1"), ("index", "<i4", 3)])
    rows["count"], rows["index"] = 3, faces
    body = vertices.astype("<f4").tobytes() + rows.tobytes()
    (folder / "scan.ply").write_bytes(header.encode() + body)
    np.savez_compressed(folder / "regions.npz", face_label=labels.astype(np.uint8))
    print(f"scan: {len(vertices)} vertices, {len(faces)} faces", flush=True)


def mark_regions(folder, shot, number, occluders, face_centres, labels):
    """Draw the masks of all regions that the shot shows whole; return their names."""
    visible = []
    for index, name in enumerate(chapel.REGIONS):
        surface = face_centres[labels == index + 1]
        if not marking.wholly_visible(shot, name, occluders, surface):
            continue
        visible.append(name)
        outline = marking.drawn_outline(shot, name, np.random.default_rng((3, number, index)))
        path = folder / "masks" / shot.name / f"{name}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        picture = np.where(marking.mask(outline), 255, 0).astype(np.uint8)
        path.write_bytes(cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_BILEVEL, 1])[1].tobytes())
    return visible


def write_truth(folder):
    """Where the cameras really stood; Fresco never reads this, only the comparison at the end does."""
    truth = {
        f"photos/{shot.name}.jpg": {
            "rotation": shot.rotation.tolist(),
            "translation": shot.translation.tolist(),
            "exposure": shot.exposure,
        }
        for shot in photography.SHOTS
    }
    (folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


def take_photos(folder, parts, shots, samples):
    photography.build_scene(parts, samples)
    (folder / "photos").mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        for number, shot in enumerate(shots):
            image = photography.photograph(shot, scratch, np.random.default_rng((4, number)))
            photography.write_jpeg(folder / "photos" / f"{shot.name}.jpg", image, shot)
            print(f"{shot.name}.jpg, mean {image.mean():.0f}, blown {np.mean(image == 255):.4f}", flush=True)


if __name__ == "__main__":
    main()
