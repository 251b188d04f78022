"""Our own shapes for the pose benchmark, drawn by code: larger side 1 m, no two alike.

`template_shapes` have no symmetry; `plain_shapes` are what buildings are full of: panels, arches, letters
and ovals, many with an exact or a near symmetry, so that one of them alone has several exact poses.
"""

import numpy as np

CORNERS = {
    "ell": [(0, 0), (1, 0), (1, 0.3), (0.35, 0.3), (0.35, 0.8), (0, 0.8)],
    "flag": [(0, 0), (0.08, 0), (0.08, 0.45), (0.9, 0.35), (0.7, 0.62), (1, 0.9), (0.08, 0.8), (0, 1)],
    "boot": [(0.1, 0), (0.45, 0), (0.42, 0.55), (0.95, 0.7), (1, 0.95), (0.05, 1), (0.15, 0.5)],
    "gable": [(0, 0.4), (0.35, 0), (0.9, 0.35), (0.9, 0.9), (0, 0.9)],
    "kite": [(0.3, 0), (1, 0.35), (0.4, 0.85), (0, 0.5)],
    "bolt": [(0.35, 0), (0.75, 0.05), (0.55, 0.35), (0.85, 0.35), (0.2, 1), (0.35, 0.55), (0.05, 0.55)],
    "step": [(0, 0), (0.3, 0), (0.3, 0.25), (0.6, 0.25), (0.6, 0.55), (1, 0.55), (1, 0.8), (0, 0.8)],
    "wedge": [(0, 0), (1, 0.25), (0.85, 0.7), (0.1, 0.5)],
    "tee": [(0, 0), (1, 0), (1, 0.22), (0.65, 0.22), (0.6, 0.9), (0.3, 0.9), (0.35, 0.22), (0, 0.22)],
    "shard": [(0, 0.3), (0.3, 0), (1, 0.1), (0.75, 0.4), (0.9, 0.8), (0.35, 0.7)],
    "key": [
        (0, 0),
        (0.35, 0),
        (0.35, 0.15),
        (1, 0.15),
        (1, 0.45),
        (0.8, 0.45),
        (0.8, 0.3),
        (0.35, 0.3),
        (0.35, 0.5),
        (0, 0.4),
    ],
    "prow": [(0, 0.2), (0.7, 0), (1, 0.4), (0.5, 0.9), (0.45, 0.5), (0.1, 0.65)],
    "quad": [(0, 0), (0.8, 0.1), (1, 0.6), (0.15, 0.75)],
    "hook": [
        (0, 0),
        (0.7, 0),
        (0.7, 0.6),
        (0.35, 0.6),
        (0.35, 0.45),
        (0.52, 0.45),
        (0.52, 0.2),
        (0.2, 0.2),
        (0.2, 1),
        (0, 1),
    ],
}
WAVES = {  # radius 1 + sum of amplitude * cos(n * angle + phase), and stretch
    "pear": ([(1, 0.2, 0.3), (2, 0.18, 1.0), (3, 0.1, 0.2)], 0.8),
    "leaf": ([(2, 0.3, 0.0), (3, 0.12, 1.2)], 0.7),
    "cloud": ([(3, 0.12, 0.5), (5, 0.1, 1.5), (2, 0.2, 2.0)], 0.75),
    "bean": ([(1, 0.1, 0.0), (2, 0.35, 0.8), (3, 0.15, 2.5)], 0.9),
    "blot": ([(2, 0.15, 0.4), (3, 0.2, 2.0), (4, 0.12, 1.0)], 1.0),
    "egg": ([(1, 0.25, 0.0), (2, 0.25, 0.9), (3, 0.12, 0.4), (4, 0.05, 0.0)], 0.6),
    "star": ([(5, 0.2, 0.0), (2, 0.2, 0.6), (1, 0.2, 2.0)], 0.85),
}
HOLED = {
    "window": ("gable", [(0.5, 0.45), (0.75, 0.45), (0.75, 0.75), (0.55, 0.75)]),
    "niche": ("quad", [(0.25, 0.2), (0.6, 0.25), (0.4, 0.5)]),
    "ring": ("pear", [(-0.1, -0.1), (0.22, -0.05), (0.15, 0.15), (-0.15, 0.2)]),
}
PLAIN_CORNERS = {
    "panel": [(0, 0), (1, 0), (1, 0.62), (0, 0.62)],
    "square": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "worn panel": [(0, 0), (1, 0.02), (0.98, 0.7), (0.01, 0.68)],
    "trapezium": [(0.1, 0), (0.9, 0), (1, 0.7), (0, 0.7)],
    "triangle": [(0, 0.8), (0.5, 0), (1, 0.8)],
    "cross": [
        (0.35, 0), (0.65, 0), (0.65, 0.3), (1, 0.3), (1, 0.6), (0.65, 0.6),
        (0.65, 1), (0.35, 1), (0.35, 0.6), (0, 0.6), (0, 0.3), (0.35, 0.3),
    ],
    "T": [(0, 0), (1, 0), (1, 0.25), (0.62, 0.25), (0.62, 1), (0.38, 1), (0.38, 0.25), (0, 0.25)],
    "L": [(0, 0), (0.25, 0), (0.25, 0.75), (1, 0.75), (1, 1), (0, 1)],
    "H": [
        (0, 0), (0.25, 0), (0.25, 0.38), (0.7, 0.38), (0.7, 0), (0.95, 0),
        (0.95, 1), (0.7, 1), (0.7, 0.62), (0.25, 0.62), (0.25, 1), (0, 1),
    ],
    "F": [
        (0, 0), (0.7, 0), (0.7, 0.2), (0.22, 0.2), (0.22, 0.42), (0.55, 0.42),
        (0.55, 0.6), (0.22, 0.6), (0.22, 1), (0, 1),
    ],
    "pediment": [(0, 0.5), (0.5, 0), (1, 0.5), (0.94, 0.5), (0.94, 0.75), (0.06, 0.75), (0.06, 0.5)],
}  # fmt: skip
PLAIN_WAVES = {
    "disc": ([], 1.0),
    "oval": ([], 0.7),
    "near oval": ([(1, 0.04, 0.3), (3, 0.03, 1.0)], 0.75),
    "heart": ([(1, 0.25, 0.0), (2, 0.08, 0.0)], 0.95),
    "clover": ([(4, 0.18, 0.4)], 1.0),
}


def _arch(height):
    """Upright sides under a half circle, as of a window."""
    angle = np.linspace(np.pi, 2 * np.pi, 40)
    top = np.stack([0.3 * np.cos(angle), 0.3 * np.sin(angle)], axis=1)
    return np.concatenate([top, [(0.3, height), (-0.3, height)]])


def plain_shapes():
    """Symmetric and nearly symmetric shapes: name -> list of loops (n,2), larger side 1 m, centred."""
    shapes = {name: [np.array(corners, dtype=float)] for name, corners in PLAIN_CORNERS.items()}
    shapes |= {name: [_wave(*wave)] for name, wave in PLAIN_WAVES.items()}
    shapes["arch"] = [_arch(0.6)]
    return {name: _normalised(loops) for name, loops in shapes.items()}


def template_shapes():
    """All shapes: name -> list of loops (n,2), the outline first, then holes; larger side 1 m, centred."""
    shapes = {name: [np.array(corners, dtype=float)] for name, corners in CORNERS.items()}
    shapes |= {name: [_wave(*wave)] for name, wave in WAVES.items()}
    for name, (base, hole) in HOLED.items():
        shapes[name] = [*shapes[base], np.array(hole)]
    return {name: _normalised(loops) for name, loops in shapes.items()}


def _wave(waves, stretch):
    """Closed curve (n,2) whose radius waves."""
    angle = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    radius = 1 + sum((a * np.cos(n * angle + phase) for n, a, phase in waves), np.zeros(120))
    loop = radius[:, None] * np.stack([np.cos(angle), stretch * np.sin(angle)], axis=1)
    return loop / np.ptp(loop, axis=0).max()


def _normalised(loops):
    low, high = loops[0].min(axis=0), loops[0].max(axis=0)
    return [(loop - 0.5 * (low + high)) / (high - low).max() for loop in loops]
