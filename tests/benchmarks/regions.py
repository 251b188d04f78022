"""Benchmark of one-click regions, fountain-P11: `python tests/benchmarks/regions.py [--write] [--only PART]`.

One click at the centre of every reference mask (photo wand) and on the face nearest to the centre of every
reference face set (surface wand), nothing corrected; intersection over union with the reference. Pictures
go to artefacts/regions/; `--write` puts the tables into docs/benchmarks.md, `--only photo` or `--only scan`
measures one of the wands. Times are CPU times of one thread.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np
import trimesh
from fresco.core.regions.photo.wand import Level, prepare_wand, prepare_wand_job
from fresco.core.regions.surface.index import index_surface
from fresco.core.regions.surface.wand import grow_surface, region_faces
from region_scans import facade_tables

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data" / "fountain-P11"
PICTURES = ROOT / "artefacts" / "regions"
DOCUMENT = ROOT / "docs" / "benchmarks.md"


def overlap(found, truth, weight=None):
    """Intersection over union of two masks, optionally weighted."""
    both, either = found & truth, found | truth
    if weight is None:
        return np.count_nonzero(both) / np.count_nonzero(either)
    return weight[both].sum() / weight[either].sum()


def photo_rows(photos):
    """(photo, region, IoU of the default, IoU of the best level offered, seconds of click and finish)."""
    rows = []
    for photo in photos:
        image = cv2.imread(str(DATA / "images" / f"{photo}.jpg"))[:, :, ::-1]
        wand = prepare_wand(image)
        for path in sorted((DATA / "masks" / photo).glob("*.png")):
            truth = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) > 0
            moments = cv2.moments(truth.astype(np.uint8), True)
            start = time.process_time()
            click = wand.click((moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]))
            clicked = time.process_time()
            loops = wand.finished(click.level())
            finished = time.process_time()
            share = overlap(wand.mask(loops), truth)
            offered = max(click.levels, key=lambda level: overlap(wand.mask([level.outline]), truth))
            best = overlap(wand.mask(wand.finished(offered)), truth)
            rows.append((photo, path.stem, share, max(best, share), clicked - start, finished - clicked))
            print(*rows[-1][:2], *(f"{value:.3f}" for value in rows[-1][2:]), flush=True)
            picture(image, truth, loops, f"{share:.3f} {photo} {path.stem}")
    return rows


def timed(job):
    """Result of a job, its CPU seconds and those of its longest step."""
    ticks = [time.process_time()]
    try:
        while True:
            next(job)
            ticks.append(time.process_time())
    except StopIteration as done:
        ticks.append(time.process_time())
        return done.value, ticks[-1] - ticks[0], np.diff(ticks).max()


def speed(photo, size=(8660, 5773)):
    """CPU seconds on a photo enlarged to 50 Mpx, as lines of Markdown.

    The largest regions are a quadrangle and a wavy oval that nearly fill the photo.
    """
    image = cv2.imread(str(DATA / "images" / f"{photo}.jpg"))[:, :, ::-1]
    large = cv2.resize(image, size, interpolation=cv2.INTER_CUBIC)
    wand, prepare, step = timed(prepare_wand_job(large))
    clicks, finishes = [], []
    for pixel in [(u * size[0], v * size[1]) for v in (0.3, 0.5, 0.7) for u in (0.25, 0.5, 0.75)]:
        start = time.process_time()
        level = wand.click(pixel).level()
        clicks.append(time.process_time() - start)
        finishes.append(timed(wand.finished_job(level))[1])
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    oval = np.stack([np.cos(angle), np.sin(angle)], axis=1) * (1 + 0.01 * np.sin(40 * angle)[:, None])
    box = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    largest = [
        timed(wand.finished_job(Level(np.array(size) * (0.5 + 0.45 * loop), 1.0, 0.0, straight)))
        for loop, straight in ((box, True), (oval, False))
    ]
    start = time.process_time()
    wand.mask(largest[1][0])
    filled = time.process_time() - start
    return [
        f"On {size[0] * size[1] / 1e6:.0f} Mpx preparing takes {prepare:.2f} s (longest step {step:.2f} s),",
        f"a click {np.median(clicks):.2f} s (worst {max(clicks):.2f} s) and finishing",
        f"{np.median(finishes):.2f} s (worst {max(finishes):.2f} s). A region that fills the photo is",
        f"finished in {largest[0][1]:.2f} s (four straight sides) or {largest[1][1]:.2f} s (oval),",
        f"in steps of at most {max(large[2] for large in largest):.2f} s; its mask takes {filled:.2f} s.",
        "Dragging shows what the click has found already.",
    ]


def picture(image, truth, loops, name):
    """Reference (green) and what was found (yellow) on the photo, cut out around both."""
    canvas = np.ascontiguousarray(image[:, :, ::-1])
    outlines, _ = cv2.findContours(truth.view(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(canvas, outlines, -1, (0, 255, 0), 3)
    cv2.polylines(canvas, [np.round(loop).astype(np.int32) for loop in loops], True, (0, 220, 255), 3)
    points = np.concatenate([outline[:, 0] for outline in outlines] + [np.round(loop) for loop in loops])
    low = np.maximum(points.min(axis=0).astype(int) - 60, 0)
    high = points.max(axis=0).astype(int) + 60
    PICTURES.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(PICTURES / f"{name}.png"), canvas[low[1] : high[1], low[0] : high[0]])


def surface_rows():
    """(region, IoU by area of the default, IoU of the best level offered, seconds of the click)."""
    # As stored: reading a scan drops faces without area, and the reference counts them.
    scan = trimesh.load(DATA / "mesh.ply", process=False)
    labels = np.load(DATA / "regions.npz")
    index = index_surface(scan.vertices, scan.faces)
    rows = []
    for region in json.loads((DATA / "regions.json").read_text())["regions"]:
        members = labels[f"faces_{region['name']}"]
        truth = np.zeros(index.face_count, dtype=bool)
        truth[members] = True
        middle = index.middle[members]
        seed = int(members[np.argmin(np.sum((middle - middle.mean(axis=0)) ** 2, axis=1))])
        start = time.process_time()
        click = grow_surface(index, seed)
        seconds = time.process_time() - start
        shares = []
        for level in click.levels:
            found = np.zeros(index.face_count, dtype=bool)
            found[region_faces(index, seed, level)] = True
            shares.append(overlap(found, truth, index.area))
        rows.append((region["name"], shares[click.best], max(shares), seconds))
        print(rows[-1][0], *(f"{value:.3f}" for value in rows[-1][1:]), flush=True)
    return rows


def photo_table(rows, times):
    """Markdown of the photo wand's table, from `photo_rows` and `speed`."""
    lines = [
        "One click per region at the centre of the reference, nothing corrected. “Offered” is the best that",
        "dragging the tolerance reaches. `python tests/benchmarks/regions.py --write --only photo`",
        "",
        "| photo wand, fountain-P11 | masks | IoU median | worst | offered, median |",
        "|---|---|---|---|---|",
    ]
    for name in [*sorted({row[1] for row in rows}), "all"]:
        chosen = np.array([row[2:4] for row in rows if name in (row[1], "all")])
        middle = np.median(chosen, axis=0)
        lines.append(
            f"| {name} | {len(chosen)} | {middle[0]:.3f} | {chosen[:, 0].min():.3f} | {middle[1]:.3f} |"
        )
    clicks = np.median([row[4:6] for row in rows], axis=0)
    lines += [
        "",
        f"Click {clicks[0]:.2f} s, finishing at full resolution {clicks[1]:.2f} s (median).",
        *times,
    ]
    return "\n".join(lines)


def scan_table(rows):
    """Markdown of the surface wand's tables, from `surface_rows`."""
    lines = [
        "`python tests/benchmarks/regions.py --write --only scan`",
        "",
        "| surface wand, fountain-P11 | IoU | offered | click, s |",
        "|---|---|---|---|",
    ]
    lines += [f"| {name} | {share:.3f} | {best:.3f} | {taken:.2f} |" for name, share, best, taken in rows]
    middle = np.median([row[1:] for row in rows], axis=0)
    lines.append(f"| median | {middle[0]:.3f} | {middle[1]:.3f} | {middle[2]:.2f} |")
    return "\n".join([*lines, *facade_tables()])


def write(part, text):
    """Put a table between its markers of docs/benchmarks.md."""
    begin, end = f"<!-- regions: {part} -->", f"<!-- regions: {part}, end -->"
    head, rest = DOCUMENT.read_text().split(begin, 1)
    DOCUMENT.write_text(f"{head}{begin}\n{text}\n{end}{rest.split(end, 1)[1]}")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=("photo", "scan"))
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    if not DATA.is_dir():
        sys.exit(f"{DATA} is not there")
    found = {}
    if arguments.only != "scan":
        for old in PICTURES.glob("*.png"):
            old.unlink()
        photos = sorted(path.name for path in (DATA / "masks").iterdir())
        found["photo"] = photo_table(photo_rows(photos), speed(photos[0]))
    if arguments.only != "photo":
        found["scan"] = scan_table(surface_rows())
    for part, text in found.items():
        print(text)
        if arguments.write:
            write(part, text)


if __name__ == "__main__":
    main()
