"""Made-up fronts from which the surface wand's evidence is learned: panels, pilasters, friezes, gables, bays.

`front(seed)` draws a layout of its own for every seed: sizes, depths, mouldings, ornament, masonry, noise,
sharpness and the direction of the scan's faces all come from it.
"""

import numpy as np
from region_scans import Relief
from scipy.ndimage import gaussian_filter, map_coordinates


def front(seed):
    """Vertices (V,3) m, faces (F,3), face set (F,) of every region, and what each face counts (F,)."""
    rng = np.random.default_rng(seed)
    step = rng.uniform(0.012, 0.026)
    columns, height = int(rng.integers(2, 5)), rng.uniform(2.6, 4.0)
    widths = rng.uniform(0.9, 1.9, columns)
    relief = Relief(float(widths.sum()) + 0.8, height + 1.2, step, seed)
    relief.part("", relief.u >= 0, 0.0)
    _masonry(relief)
    _band(relief, height + 0.75)
    left = 0.4
    for number, width in enumerate(widths):
        middle = left + width / 2
        maker = rng.choice([_bay, _panels, _panels, _pilasters, _gable, _window])
        maker(relief, str(number), middle, width, height)
        left += width
    turn = rng.uniform(-0.4, 0.4, 2)
    _weathered(relief)
    points, faces, sets, weight = relief.scan(
        step * rng.uniform(0.03, 0.25), rng.uniform(0.7, 2.6), _bent(turn), int(rng.integers(0, 10))
    )
    return points, faces, sets, weight


def _weathered(relief):
    """Edges that waver by about a face, and worn surfaces."""
    rng, step = relief.rng, relief.step
    waver = rng.uniform(0.0, 0.8) * np.stack([_field(relief, rng.uniform(4, 12) * step) for _ in range(2)])
    rows, columns = np.indices(relief.u.shape)
    place = [rows + waver[0], columns + waver[1]]
    relief.depth = map_coordinates(relief.depth, place, order=1, mode="nearest")
    relief.label = map_coordinates(relief.label, place, order=0, mode="nearest")
    relief.ornament(relief.u >= 0, rng.uniform(0, 0.15) * step * _field(relief, rng.uniform(3, 10) * step))


def _bent(turn):
    """Front turned about the upright and leaning back, by radians (2,)."""
    cos, sin = np.cos(turn), np.sin(turn)

    def base(u, v, depth):
        x, y = cos[0] * u - sin[0] * depth, sin[0] * u + cos[0] * depth
        return x, cos[1] * v - sin[1] * y, sin[1] * v + cos[1] * y

    return base


def _masonry(relief):
    """Bricks, ashlar or plaster on the wall."""
    rng, u, v = relief.rng, relief.u, relief.v
    kind = rng.choice(["bricks", "ashlar", "plaster", "plaster"])
    if kind == "plaster":
        relief.ornament(u >= 0, rng.uniform(0, 0.006) * _field(relief, rng.uniform(0.1, 0.5)))
        return
    high = rng.uniform(0.08, 0.14) if kind == "bricks" else rng.uniform(0.3, 0.5)
    row = np.floor(v / high)
    along = (u / (2.2 * high) + 0.5 * (row % 2)) % 1
    joint = (v % high < 0.012) | (along * 2.2 * high < 0.012)
    relief.ornament(joint, -rng.uniform(0.004, 0.012))
    block = rng.normal(0, rng.uniform(0, 0.006), 100_000)
    number = (row * 313 + np.floor(u / (2.2 * high) + 0.5 * (row % 2))).astype(int) % len(block)
    relief.ornament(u >= 0, block[number])


def _field(relief, size):
    """Unit relief of lumps of `size` m."""
    field = gaussian_filter(relief.rng.normal(0, 1, relief.u.shape), size / relief.step / 3)
    return field / max(field.std(), 1e-9)


def _carved(relief, inside, border, size):
    """Ornament of one kind on a region: none, lumps, bosses, lozenges, flutes or a crest in its middle."""
    rng, u, v = relief.rng, relief.u, relief.v
    deep = rng.uniform(0.04, 0.15) * size
    within = inside > border
    kind = rng.choice(["none", "none", "lumps", "bosses", "lozenges", "flutes", "crest"])
    if not within.any():
        return
    x, y = u - u[within].mean(), v - v[within].mean()
    if kind == "lumps":
        relief.ornament(within, 0.3 * deep * _field(relief, 0.3 * size))
    elif kind == "bosses":
        apart = size * rng.uniform(0.5, 0.9)
        away = np.hypot(x - apart * np.round(x / apart), y - apart * np.round(y / apart)) / (0.3 * apart)
        relief.ornament(within, deep * np.sqrt(np.maximum(1 - away**2, 0)))
    elif kind == "lozenges":
        apart = size * rng.uniform(0.5, 1.0)
        stripes = np.minimum(np.abs((x + y) % apart - apart / 2), np.abs((x - y) % apart - apart / 2))
        relief.ornament(within & (stripes < 0.06 * apart), 0.4 * deep)
    elif kind == "flutes":
        apart = size / rng.integers(3, 7)
        relief.ornament(inside > 1.5 * border + 0.1 * size, -0.5 * deep * np.abs(np.sin(np.pi * x / apart)))
    elif kind == "crest":
        away = np.hypot(x, y) / (0.35 * size)
        relief.ornament(
            within, 1.5 * deep * np.maximum(1 - away**2, 0) * (1 + 0.3 * _field(relief, 0.1 * size))
        )


def _field_of(relief, name, inside, depth, size):
    """Region at a depth behind or before the wall, with or without a moulding, and its ornament.

    `inside` (H,W) is the distance (m) from its outline.
    """
    rng = relief.rng
    wide = rng.choice([0.0, rng.uniform(0.03, 0.08)])
    if wide:
        out = inside > -wide
        profile = rng.choice(["round", "raised", "slope"])
        t = np.clip((inside + wide) / wide, 0, 1)
        shape = {"round": np.sqrt(np.maximum(1 - (2 * t - 1) ** 2, 0)), "raised": 1.0 + 0 * t, "slope": t}[
            profile
        ]
        relief.part("", out, relief.depth + rng.uniform(0.3, 0.8) * wide * shape)
    relief.part(name, inside > 0, depth)
    _carved(relief, inside, 0.04 * size, size)


def _panels(relief, name, x, width, height):
    """One to three panels above each other."""
    rng = relief.rng
    count = int(rng.integers(1, 4))
    high = height / count
    for k in range(count):
        w, h = width * rng.uniform(0.5, 0.85), high * rng.uniform(0.5, 0.85)
        inside = relief.box(x, 0.3 + high * (k + 0.5), w, h)
        depth = rng.choice([-1, 1]) * rng.uniform(0.015, 0.09)
        _field_of(relief, f"panel {name} {k}", inside, depth, min(w, h))


def _pilasters(relief, name, x, width, height):
    """One or two pilasters on a plinth, under a capital."""
    rng = relief.rng
    count = int(rng.integers(1, 3))
    for k in range(count):
        w = width / count * rng.uniform(0.25, 0.5)
        place = x + width * ((k + 0.5) / count - 0.5)
        low, high = 0.25 + rng.uniform(0.1, 0.4), height + rng.uniform(-0.5, 0.0)
        depth = rng.uniform(0.03, 0.12)
        relief.part("", relief.box(place, low / 2 + 0.1, 1.3 * w, low) > 0, depth + rng.uniform(0.02, 0.05))
        relief.part("", relief.box(place, high + 0.12, 1.3 * w, 0.25) > 0, depth + rng.uniform(0.02, 0.05))
        inside = relief.box(place, (low + 0.1 + high) / 2, w, high - low - 0.1)
        relief.part(f"pilaster {name} {k}", inside > 0, depth)
        _carved(relief, inside, 0.06 * w, w)


def _gable(relief, name, x, width, height):
    """Gable with a sunk field over a window."""
    rng = relief.rng
    w, base, rise = 0.85 * width, height * rng.uniform(0.55, 0.75), rng.uniform(0.3, 0.7) * width * 0.5
    band, out = rng.uniform(0.05, 0.1), rng.uniform(0.06, 0.15)
    up = relief.v - base
    slope = np.hypot(1, 2 * rise / w)
    roof = (rise * (1 - np.abs(relief.u - x) / (w / 2)) - up) / slope
    relief.part("", (up > 0) & (roof > 0), out)
    inside = np.minimum(up - band, roof - band)
    relief.part(f"gable {name}", inside > 0, out - rng.uniform(0.04, 0.12))
    _carved(relief, inside, 0.01, rise)
    _opening(relief, f"window {name}", x, base * 0.52, 0.6 * w, base * 0.75)


def _window(relief, name, x, width, height):
    """Window or door."""
    rng = relief.rng
    high = height * rng.uniform(0.4, 0.9)
    _opening(relief, f"window {name}", x, 0.25 + high / 2, width * rng.uniform(0.4, 0.75), high)


def _opening(relief, name, x, y, width, height):
    rng = relief.rng
    frame = rng.choice([0.0, rng.uniform(0.06, 0.14)])
    if frame:
        around = relief.box(x, y, width + 2 * frame, height + 2 * frame) > 0
        relief.part(name.replace("window", "frame"), around, rng.uniform(0.02, 0.06))
    relief.part(name, relief.box(x, y, width, height) > 0, -rng.uniform(0.05, 0.25))
    if rng.random() < 0.5:  # bars
        bar = (np.abs(relief.u - x) < 0.025) | (np.abs((relief.v - y) % (height / 3) - height / 6) < 0.02)
        relief.ornament(bar & (relief.box(x, y, width, height) > 0), 0.03)


def _bay(relief, name, x, width, height):
    """Bay of three sides between two mouldings: the front and both oblique sides are regions."""
    rng = relief.rng
    w, out = 0.9 * width, width * rng.uniform(0.1, 0.25)
    front = w * rng.uniform(0.35, 0.6)
    depth = out * np.clip((w / 2 - np.abs(relief.u - x)) / ((w - front) / 2), 0, 1)
    low, high = 0.2 + 0.3 * height * rng.random(), height * rng.uniform(0.7, 0.95)
    inside = np.minimum(relief.box(x, (low + high) / 2, w, high - low), 1)
    relief.part("", inside > 0, depth)
    band = rng.uniform(0.05, 0.12)
    upright = np.minimum(relief.v - low - band, high - band - relief.v)
    bulge = rng.uniform(0.02, 0.05) * np.sqrt(np.clip(-upright / band, 0, 1))
    relief.ornament((inside > 0) & (upright < 0), bulge)
    off = relief.u - x
    for side, part in (
        ("front", front / 2 - np.abs(off)),
        ("left", np.minimum(off + w / 2, -off - front / 2)),
        ("right", np.minimum(off - front / 2, w / 2 - off)),
    ):
        chosen = np.minimum(part, upright)
        if front / 2 > 4 * relief.step:
            relief.part(f"bay {side} {name}", chosen > 0, relief.depth)
            _carved(relief, chosen, 0.03, min(front, high - low) * 0.6)


def _band(relief, y):
    """Frieze or cornice over the whole front, between mouldings or not."""
    rng = relief.rng
    width, high = relief.u.max() * rng.uniform(0.8, 0.97), rng.uniform(0.2, 0.4)
    inside = relief.box(relief.u.max() / 2, y, width, high)
    for edge in (-1, 1):
        if rng.random() < 0.6:
            moulding = relief.box(relief.u.max() / 2, y + edge * (high / 2 + 0.03), width, 0.06)
            relief.part("", moulding > 0, rng.uniform(0.06, 0.14))
    relief.part("frieze", inside > 0, rng.uniform(-0.04, 0.1))
    _carved(relief, inside, 0.02, high)
