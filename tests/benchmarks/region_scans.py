"""Made-up facades with known regions, for the benchmark of the surface wand.

Every scan is a relief over a jittered grid: wall, windows, a door, pilasters, flush panels, an ornamented
frieze, a half column and a hollow niche, blurred over a few faces as a scanner does. Positions, depths and
noise come from the seed.
"""

import time
import tracemalloc

import numpy as np
from fresco.core.regions.surface_index import index_surface
from fresco.core.regions.surface_wand import grow_surface, region_faces
from scipy.ndimage import gaussian_filter

WIDTH, HEIGHT = 8.0, 5.0


def facade(step=0.02, noise=0.003, seed=0, blur=0.7):
    """Vertices (V,3) m, faces (F,3), face set (F,) bool of every region, and what each face counts (F,).

    Faces count by their area seen from the front; the steep ones of a step belong to neither side and count
    nothing.
    """
    rng = np.random.default_rng(seed)
    columns, rows = round(WIDTH / step) + 1, round(HEIGHT / step) + 1
    u, v = np.meshgrid(np.arange(columns) * step, np.arange(rows) * step)
    label, depth = np.zeros(u.shape, dtype=int), np.zeros(u.shape)
    names = ["wall"]
    for name, inside, relief in _parts(u, v, rng):
        label[inside], depth[inside] = len(names), relief[inside]
        names.append(name)
    relief = gaussian_filter(depth, blur)
    steep = np.hypot(*np.gradient(relief, step)).ravel() > 1
    relief += rng.normal(0, noise, relief.shape) + 0.7 * noise * _bumps(rng, relief.shape)
    shift = rng.uniform(-0.25, 0.25, (2, *u.shape)) * step
    vertices = np.stack([(u + shift[0]).ravel(), (v + shift[1]).ravel(), relief.ravel()], axis=1)
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate(
        [np.stack([a, a + 1, a + columns], 1), np.stack([a + 1, a + columns + 1, a + columns], 1)]
    )
    votes = np.sort(label.ravel()[faces], axis=1)[:, 1]
    weight = np.where(np.all(steep[faces], axis=1), 0.0, 1.0) * step * step / 2
    return vertices, faces, {name: votes == k for k, name in enumerate(names)}, weight


def _bumps(rng, shape):
    """Unit noise that hangs together over a few faces, as that of scanners does."""
    field = gaussian_filter(rng.normal(0, 1, shape), 2)
    return field / field.std()


def _parts(u, v, rng):
    """Name, where, relief (m) of the parts of the facade, at places that vary a little."""

    def box(x, y, width, height):
        return (np.abs(u - x) < width / 2) & (np.abs(v - y) < height / 2)

    wobble = rng.uniform(-0.08, 0.08, 20)
    none = np.zeros_like(u)
    yield "frieze", box(4, 4.55 + wobble[0], 7.4, 0.34), 0.06 + 0.02 * np.sin(9 * u) * np.sin(18 * v)
    yield "window left", box(1.2 + wobble[1], 2.9, 0.9, 1.3), none - rng.uniform(0.06, 0.2)
    yield "window right", box(6.8 + wobble[2], 2.9, 0.9, 1.3), none - rng.uniform(0.06, 0.2)
    yield "door", box(4 + wobble[3], 1.1, 1.1, 2.2), none - rng.uniform(0.1, 0.3)
    yield "pilaster left", box(2.6 + wobble[4], 2.2, 0.3, 3.6), none + rng.uniform(0.04, 0.09)
    yield "pilaster right", box(5.4 + wobble[5], 2.2, 0.3, 3.6), none + rng.uniform(0.04, 0.09)
    yield "flush panel", box(1.2 + wobble[6], 1.1, 1.3, 0.9), none + 0.015
    yield "small panel", box(4 + wobble[7], 3.4, 0.5, 0.4), none + 0.02
    x = (u - 7.2 - wobble[8]) / 0.25
    yield "column", (np.abs(x) < 0.9) & (v > 0.3) & (v < 2.0), 0.25 * np.sqrt(np.maximum(1 - x * x, 0))
    x = (u - 6.2 - wobble[9]) / 0.35
    yield "niche", (np.abs(x) < 0.9) & (np.abs(v - 1.1) < 0.7), -0.35 * np.sqrt(np.maximum(1 - x * x, 0))


def centre_face(vertices, faces, members):
    """Face of a set (F,) nearest to its middle: where a user would click."""
    chosen = np.flatnonzero(members)
    middle = vertices[faces[chosen]].mean(axis=1)
    return int(chosen[np.argmin(np.sum((middle - middle.mean(axis=0)) ** 2, axis=1))])


def clicked(index, seed, level, truth, weight):
    """Intersection over union of a level with a set of faces (F,), faces counted by weight (F,)."""
    found = np.zeros(len(truth), dtype=bool)
    found[region_faces(index, seed, level)] = True
    return weight[found & truth].sum() / weight[found | truth].sum()


def facade_rows(noise, seed):
    """(IoU of the default, IoU of the best level offered) of every region, clicked in the middle."""
    vertices, faces, regions, weight = facade(noise=noise, seed=seed)
    index = index_surface(vertices, faces)
    rows = []
    for name, truth in regions.items():
        face = centre_face(vertices, faces, truth)
        click = grow_surface(index, face)
        shares = [clicked(index, face, level, truth, weight) for level in click.levels]
        rows.append((shares[click.best], max(shares)))
        print(f"{1000 * noise:.0f} mm", name, *(f"{share:.3f}" for share in rows[-1]), flush=True)
    return np.array(rows)


def speed_row(million):
    """Preparation s and MB (peak), click s (median, worst), border s (median, worst) on so many faces."""
    vertices, faces, regions, _ = facade(np.sqrt(WIDTH * HEIGHT * 2 / (million * 1e6)), noise=0.002, blur=1.5)
    start = time.process_time()
    index = index_surface(vertices, faces)
    prepared = time.process_time() - start
    times = []
    for truth in regions.values():
        face = centre_face(vertices, faces, truth)
        ticks = [time.process_time()]
        level = grow_surface(index, face).level()
        ticks.append(time.process_time())
        region_faces(index, face, level)
        times.append(np.diff([*ticks, time.process_time()]))
    del index
    tracemalloc.start()
    index_surface(vertices, faces)
    memory = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    click, border = np.array(times).T
    return prepared, memory, np.median(click), click.max(), np.median(border), border.max()


def facade_tables():
    """Lines of Markdown: quality on made-up facades, and times by size."""
    lines = ["", "| surface wand, made-up facades | regions | IoU median | worst | offered, median |"]
    lines += ["|---|---|---|---|---|"]
    for noise, seed in ((0.002, 1), (0.004, 2), (0.006, 3)):
        rows = facade_rows(noise, seed)
        middle = np.median(rows, axis=0)
        lines.append(
            f"| noise {1000 * noise:.0f} mm, faces of 20 mm | {len(rows)} | {middle[0]:.3f} "
            f"| {rows[:, 0].min():.3f} | {middle[1]:.3f} |"
        )
    lines += ["", "| faces | preparation, s | peak MB | click, s | worst | border, s | worst |"]
    lines += ["|---|---|---|---|---|---|---|"]
    for million in (0.2, 1.0, 2.0):
        prepared, memory, *times = speed_row(million)
        lines.append(
            f"| {million:.1f} M | {prepared:.1f} | {memory:.0f} | "
            + " | ".join(f"{seconds:.2f}" for seconds in times)
            + " |"
        )
    return lines
