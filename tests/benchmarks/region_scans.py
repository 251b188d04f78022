"""Made-up buildings with known regions, for the benchmark of the surface wand.

Every scan is a relief over a jittered grid, blurred over a few faces as a scanner does. Positions, depths
and noise come from the seed. `facade` is plain: wall, windows, a door, pilasters, flush panels, a wavy
frieze, a half column and a hollow niche. `palace` is rich: rosettes, flutes, mouldings, joints of ashlar and
holes in the scan. `church` is a wall with piers under a barrel vault with ribs.
"""

import time
import tracemalloc

import numpy as np
from fresco.core.regions.surface.index import index_surface
from fresco.core.regions.surface.wand import grow_surface, region_faces
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree


class Relief:
    """Depths (m) and labels over a grid of `width` x `height` m, built part by part."""

    def __init__(self, width, height, step, seed):
        self.rng, self.step = np.random.default_rng(seed), step
        columns, rows = round(width / step) + 1, round(height / step) + 1
        self.u, self.v = np.meshgrid(np.arange(columns) * step, np.arange(rows) * step)
        self.label, self.depth = np.zeros(self.u.shape, dtype=int), np.zeros(self.u.shape)
        self.names = []

    def part(self, name, inside, depth):
        """Region of its own where `inside`, at a depth."""
        self.names.append(name)
        self.label[inside] = len(self.names)
        self.depth[inside] = np.broadcast_to(depth, inside.shape)[inside]

    def ornament(self, inside, depth):
        """Relief upon whatever is there."""
        self.depth[inside] += np.broadcast_to(depth, inside.shape)[inside]

    def box(self, x, y, width, height):
        """Distance (m) inside a rectangle's border, negative outside."""
        return np.minimum(width / 2 - np.abs(self.u - x), height / 2 - np.abs(self.v - y))

    def disc(self, x, y, radius):
        """Distance (m) inside a circle."""
        return radius - np.hypot(self.u - x, self.v - y)

    def wobble(self, size=0.08):
        """Some metres up or down."""
        return self.rng.uniform(-size, size)

    def scan(self, noise, blur=0.7, base=None, holes=0):
        """Vertices (V,3) m, faces (F,3), face set (F,) bool of every region, and what each face counts (F,).

        Faces count by their area seen from the front; the steep ones of a step belong to neither side and
        count nothing. `base` bends the wall: (u, v, depth) -> points.
        """
        rng, step, (rows, columns) = self.rng, self.step, self.u.shape
        relief = gaussian_filter(self.depth, blur)
        steep = np.hypot(*np.gradient(relief, step)).ravel() > 1
        relief += rng.normal(0, noise, relief.shape) + 0.7 * noise * _bumps(rng, relief.shape)
        u, v = np.stack([self.u, self.v]) + rng.uniform(-0.25, 0.25, (2, *self.u.shape)) * step
        points = np.stack((base or (lambda *axes: axes))(u, v, relief), axis=-1).reshape(-1, 3)
        a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        faces = np.concatenate(
            [np.stack([a, a + 1, a + columns], 1), np.stack([a + 1, a + columns + 1, a + columns], 1)]
        )
        for _ in range(holes):
            hole = self.disc(rng.uniform(0, self.u.max()), rng.uniform(0, self.v.max()), 2.5 * step)
            faces = faces[~np.any(hole.ravel()[faces] > 0, axis=1)]
        votes = np.sort(self.label.ravel()[faces], axis=1)[:, 1]
        weight = np.where(np.all(steep[faces], axis=1), 0.0, 1.0) * step * step / 2
        sets = {name: votes == k for k, name in enumerate(self.names, 1) if name}
        return points, faces, sets, weight


def _bumps(rng, shape):
    """Unit noise that hangs together over a few faces, as that of scanners does."""
    field = gaussian_filter(rng.normal(0, 1, shape), 2)
    return field / field.std()


def facade(step=0.02, noise=0.003, seed=0, blur=0.7):
    """Plain front of 8 x 5 m; see `Relief.scan` for what comes back."""
    relief = Relief(8.0, 5.0, step, seed)
    rng, u, v, box, wobble = relief.rng, relief.u, relief.v, relief.box, relief.wobble
    relief.part("wall", u >= 0, 0.0)
    relief.part(
        "frieze", box(4, 4.55 + wobble(), 7.4, 0.34) > 0, 0.06 + 0.02 * np.sin(9 * u) * np.sin(18 * v)
    )
    relief.part("window left", box(1.2 + wobble(), 2.9, 0.9, 1.3) > 0, -rng.uniform(0.06, 0.2))
    relief.part("window right", box(6.8 + wobble(), 2.9, 0.9, 1.3) > 0, -rng.uniform(0.06, 0.2))
    relief.part("door", box(4 + wobble(), 1.1, 1.1, 2.2) > 0, -rng.uniform(0.1, 0.3))
    relief.part("pilaster left", box(2.6 + wobble(), 2.2, 0.3, 3.6) > 0, rng.uniform(0.04, 0.09))
    relief.part("pilaster right", box(5.4 + wobble(), 2.2, 0.3, 3.6) > 0, rng.uniform(0.04, 0.09))
    relief.part("flush panel", box(1.2 + wobble(), 1.1, 1.3, 0.9) > 0, 0.015)
    relief.part("small panel", box(4 + wobble(), 3.4, 0.5, 0.4) > 0, 0.02)
    x = (u - 7.2 - wobble()) / 0.25
    inside = (np.abs(x) < 0.9) & (v > 0.3) & (v < 2.0)
    relief.part("column", inside, 0.25 * np.sqrt(np.maximum(1 - x * x, 0)))
    x = (u - 6.2 - wobble()) / 0.35
    inside = (np.abs(x) < 0.9) & (np.abs(v - 1.1) < 0.7)
    relief.part("niche", inside, -0.35 * np.sqrt(np.maximum(1 - x * x, 0)))
    return relief.scan(noise, blur)


def palace(step=0.02, noise=0.003, seed=0, scale=1.0, holes=12):
    """Rich front of 6 x 4 m, `scale` times as large."""
    s = scale
    relief = Relief(6 * s, 4 * s, step, seed)
    u, v, box, disc = relief.u, relief.v, relief.box, relief.disc

    def wobble():
        return relief.wobble(0.05 * s)

    relief.part("wall", u >= 0, 0.0)
    relief.part("plinth", v < 0.7 * s, 0.08 * s)
    joints = (np.abs(v - 0.35 * s) < 0.015 * s) | (np.abs((u + 0.3 * s) % (0.6 * s) - 0.3 * s) < 0.015 * s)
    relief.ornament(joints & (v < 0.7 * s), -0.012 * s)
    frieze = box(3 * s, 3.7 * s + wobble(), 5.6 * s, 0.32 * s)
    relief.part("rosettes", frieze > 0, 0.05 * s)
    for x in np.arange(0.5, 6, 0.5) * s:
        rosette = disc(x, 3.7 * s, 0.1 * s)
        relief.ornament((rosette > 0) & (frieze > 0), 0.03 * s * np.sqrt(np.maximum(rosette, 0) / (0.1 * s)))
    _moulded_panel(relief, "moulded panel", (1.5 * s + wobble(), 2.2 * s, 1.3 * s, 1.0 * s), 0.05 * s)
    _moulded_panel(relief, "raised panel", (1.5 * s + wobble(), 1.2 * s, 1.1 * s, 0.55 * s), -0.03 * s)
    for name, x in (("fluted left", 0.4 * s), ("fluted right", 5.6 * s)):
        x += wobble()
        inside = box(x, 2.1 * s, 0.36 * s, 2.6 * s)
        relief.part(name, inside > 0, 0.06 * s)
        flute = 0.03 * s - np.abs((u - x + 0.16 * s) % (0.08 * s) - 0.04 * s)
        relief.ornament((flute > 0) & (inside > 0.03 * s), -np.sqrt(np.maximum(flute, 0) * 0.03 * s) * 0.5)
    _gabled_window(relief, 4.0 * s + wobble(), s)
    return relief.scan(noise, holes=holes)


def _moulded_panel(relief, name, place, depth):
    """Panel sunk (or raised) behind a round moulding as wide as the panel is deep, with a boss."""
    inside, wide = relief.box(*place), abs(depth)
    relief.part("", inside > -wide / 2, 0.0)
    relief.part(name, inside > wide / 2, 0.0)
    t = np.clip(inside / wide + 0.5, 0, 1)
    relief.ornament(inside > -wide / 2, -depth * (1 - np.sqrt(np.maximum(1 - t * t, 0))))
    rose = relief.disc(place[0], place[1], 0.18 * min(place[2:]))
    relief.ornament(rose > 0, 0.5 * wide * np.sqrt(np.maximum(rose, 0) / (0.18 * min(place[2:]))))


def _gabled_window(relief, x, s):
    """Window with a raised frame, under a gable whose field is sunk and carries a ball."""
    relief.part("frame", relief.box(x, 1.9 * s, 1.3 * s, 1.7 * s) > 0, 0.05 * s)
    relief.part("window", relief.box(x, 1.9 * s, 0.9 * s, 1.3 * s) > 0, -0.12 * s)
    height = 0.55 * s * (1 - np.abs(relief.u - x) / (0.85 * s))
    up = relief.v - 2.8 * s
    relief.part("", (up > 0) & (up < height), 0.1 * s)
    relief.part("gable", (up > 0.07 * s) & (up < height - 0.09 * s), 0.0)
    ball = relief.disc(x, 2.97 * s, 0.08 * s)
    relief.ornament(ball > 0, np.sqrt(np.maximum(ball, 0) * 0.08 * s))


def church(step=0.03, noise=0.004, seed=0):
    """Wall with two piers under half a barrel vault with ribs: 9 m long, wall 3 m, vault of radius 2.5 m."""
    relief = Relief(9.0, 6.5, step, seed)
    u, v, box = relief.u, relief.v, relief.box
    first, second = 2.0 + relief.wobble(), 7.0 + relief.wobble()
    for bay, inside in (("left", u < first), ("middle", (u > first) & (u < second)), ("right", u > second)):
        relief.part(f"wall {bay}", inside & (v < 3.1), 0.0)
        relief.part(f"vault {bay}", inside & (v >= 3.1), 0.0)
    relief.part("cornice", np.abs(v - 3.1) < 0.13, 0.12)
    for k, x in enumerate((first, second)):
        relief.part(f"pier {k + 1}", box(x, 1.4, 0.7, 3.2) > 0, 0.15)
        relief.part(f"rib {k + 1}", box(x, 5.2, 0.45, 3.95) > 0, 0.1)
    inside = (np.abs(u - 4.5) < 0.8) & (v > 0.4) & (v < 1.6 + np.sqrt(np.maximum(0.64 - (u - 4.5) ** 2, 0)))
    relief.part("arched niche", inside, -0.25)
    relief.part("tablet", box(0.8, 1.5, 0.8, 1.0) > 0, 0.03)

    def base(along, up, depth):
        angle = np.maximum(up - 3.0, 0) / 2.5
        return (
            along,
            np.minimum(up, 3.0) + (2.5 - depth) * np.sin(angle),
            np.where(up > 3, 2.5 - (2.5 - depth) * np.cos(angle), depth),
        )

    return relief.scan(noise, base=base, holes=10)


def centre_face(vertices, faces, members):
    """Face of a set (F,) where a user would click: near its middle, far from its border."""
    middle = vertices[faces].mean(axis=1)
    depth = cKDTree(middle[~members]).query(middle[members])[0]
    deep = np.flatnonzero(members)[depth > 0.8 * depth.max()]
    return int(deep[np.argmin(np.sum((middle[deep] - middle[members].mean(axis=0)) ** 2, axis=1))])


SCANS = (
    ("plain front, noise 2 mm, faces of 20 mm", lambda: facade(noise=0.002, seed=1)),
    ("plain front, noise 4 mm, faces of 20 mm", lambda: facade(noise=0.004, seed=2)),
    ("plain front, noise 6 mm, faces of 20 mm", lambda: facade(noise=0.006, seed=3)),
    ("rich front, noise 3 mm, faces of 20 mm", lambda: palace(noise=0.003, seed=4)),
    ("rich front, large, noise 6 mm, faces of 40 mm", lambda: palace(0.04, 0.006, 5, 1.6)),
    ("rich front, small, noise 2 mm, faces of 8 mm", lambda: palace(0.008, 0.002, 6, 0.4)),
    ("church, noise 4 mm, faces of 30 mm", lambda: church(seed=7)),
)
"""Title and maker of every scan whose regions are clicked; sizes, noises and seeds of their own."""


def clicked(index, seed, level, truth, weight):
    """Intersection over union of a level with a set of faces (F,), faces counted by weight (F,)."""
    found = np.zeros(len(truth), dtype=bool)
    found[region_faces(index, seed, level)] = True
    return weight[found & truth].sum() / weight[found | truth].sum()


def scan_rows(vertices, faces, regions, weight):
    """(IoU of the default, IoU of the best level offered) of every region, clicked in the middle."""
    index = index_surface(vertices, faces)
    rows = []
    for name, truth in regions.items():
        face = centre_face(vertices, faces, truth)
        click = grow_surface(index, face)
        shares = [clicked(index, face, level, truth, weight) for level in click.levels]
        rows.append((shares[click.best], max(shares)))
        print(name, *(f"{share:.3f}" for share in rows[-1]), flush=True)
    return np.array(rows)


def speed_row(million):
    """Preparation s and MB (peak), click s (median, worst), border s (median, worst) on so many faces."""
    vertices, faces, regions, _ = facade(np.sqrt(80 / (million * 1e6)), noise=0.002, blur=1.5)
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
    lines = [
        "",
        "| surface wand, made-up scans | regions | IoU median | below 0.5 | worst | offered, median |",
    ]
    lines += ["|---|---|---|---|---|---|"]
    for title, scan in SCANS:
        rows = scan_rows(*scan())
        middle = np.median(rows, axis=0)
        lines.append(
            f"| {title} | {len(rows)} | {middle[0]:.3f} | {np.count_nonzero(rows[:, 0] < 0.5)} "
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
