"""The sample's chapel corner: where everything stands and what is painted on it.

World frame: x along the back wall, y into the room is negative, z up; metres. The back wall is y = 0 and
looks to -y, the side wall is x = 0 and looks to +x.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from painting import (
    BLUE,
    BROWN,
    CREAM,
    DARK_RED,
    GREEN,
    GREY,
    OCHRE,
    PINK,
    RED,
    SKY,
    WHITE,
    Canvas,
    ashlar,
    blend,
    cracks,
    figure,
    lettering,
    marble,
    mottle,
    noise,
    scroll,
    stars,
    stones,
    weather,
    wood,
    zigzag_border,
)
from surfaces import Feature, Shape, Wall, box, grid_faces, revolved

RESOLUTION = 0.00135
BACK, SIDE, HEIGHT = 5.2, 3.6, 4.1
DADO, FRIEZE = 0.72, (2.98, 3.26)
PROFILE = (
    (-0.01, 0.05), (0.7, 0.05), (0.74, 0.012), (0.77, 0.0), (3.3, 0.0), (3.34, 0.03), (3.42, 0.04),
    (3.5, 0.12), (3.55, 0.15), (3.62, 0.15), (3.65, 0.0), (4.2, 0.0),
)  # fmt: skip
PLAQUE = ((0.0, 0.035), (0.03, 0.0))
DOOR = ((-0.03, -0.05), (0.03, 0.02), (0.16, 0.02), (0.175, 0.0))
SPLAY = ((-0.16, -0.34), (0.0, 0.0), (0.002, 0.0))

SAINT = Shape(0.62, 1.0, 0.4, 2.72, arched=True)
NICHE = Shape(1.98, 0.98, 0.6, 2.78, arched=True)
ANNUNCIATION = Shape(3.6, 1.12, 0.72, 2.5)
TABLET = Shape(0.68, 1.0, 0.38, 1.62)
WINDOW = Shape(0.7, 1.98, 0.34, 2.82, arched=True)
DOORWAY = Shape(2.15, -0.4, 0.5, 2.2, arched=True)


@dataclass(frozen=True)
class Part:
    """A piece of the sample: vertices (V,3) m, faces, picture, uv (V,2) with (0,0) at its lower left."""

    name: str
    vertices: np.ndarray
    uv: np.ndarray
    faces: np.ndarray
    picture: np.ndarray


@dataclass(frozen=True)
class Outline:
    """A region's true outline on its wall: closed polygon in the wall's plane and its shape."""

    wall: str
    shape: Shape
    offset: float


REGIONS = {
    "saint": Outline("back", SAINT, 0.0),
    "niche": Outline("back", NICHE, 0.0),
    "annunciation": Outline("back", ANNUNCIATION, 0.0),
    "tablet": Outline("side", TABLET, 0.0),
    "door": Outline("side", DOORWAY, -0.03),
}

BACK_WALL = Wall(
    BACK, HEIGHT, PROFILE,
    {
        "saint": Feature(SAINT),
        "niche": Feature(NICHE, ((0.0, 0.0), (0.02, 0.02), (0.09, 0.02), (0.105, 0.0)), niche_depth=0.3),
        "annunciation": Feature(ANNUNCIATION, ((0.0, -0.006), (0.02, 0.018), (0.08, 0.018), (0.1, 0.0))),
    },
)  # fmt: skip
SIDE_WALL = Wall(
    SIDE, HEIGHT, PROFILE,
    {
        "tablet": Feature(TABLET, PLAQUE),
        "window": Feature(WINDOW, SPLAY, hole_below=-0.16),
        "door": Feature(DOORWAY, DOOR),
    },
)  # fmt: skip
WALLS = {"back": BACK_WALL, "side": SIDE_WALL}


def on_wall(name, points):
    """Lift points of a wall's plane onto its relief: (N,2) -> (N,3) world."""
    relief = WALLS[name].relief(points)
    if name == "back":
        return np.stack([points[:, 0], -relief, points[:, 1]], axis=1)
    return np.stack([relief, -points[:, 0], points[:, 1]], axis=1)


def parts(seed=7):
    """Everything in the sample, modelled and painted: list of Part."""
    rng = np.random.default_rng(seed)
    return [
        _wall_part("back", paint_back(seed + 1), rng),
        _wall_part("side", paint_side(seed + 2), rng),
        _floor(seed + 3),
        _column(seed + 4),
        _bench(seed + 5),
    ]


def _wall_part(name, canvas, rng):
    wall = WALLS[name]
    plane, faces = wall.mesh(rng, fine=0.026, coarse=0.04)
    vertices = on_wall(name, plane)
    towards_room = np.array([0, -1.0, 0]) if name == "back" else np.array([1.0, 0, 0])
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    flipped = np.cross(b - a, c - a) @ towards_room < 0
    faces[flipped] = faces[flipped][:, ::-1]
    return Part(name, vertices, plane / (wall.length, wall.height), faces, canvas.finished())


def paint_plaster(length, seed):
    """Limewashed wall with painted ashlar, dado of cut stone, scroll frieze and stone cornice."""
    canvas = Canvas(length, HEIGHT, RESOLUTION, seed)
    mottle(canvas, 0.035, 420)
    ashlar(canvas, (0, 0.77), (length, 2.96))
    scroll(canvas, (0, FRIEZE[0]), (length, FRIEZE[1]))
    stones(canvas, (0, 0), (length, DADO + 0.03), 0.25, 0.5)
    stones(canvas, (0, 3.28), (length, 3.66), 0.38, 0.8, (206, 192, 164))
    for across in np.arange(0.03, length, 0.09):
        canvas.fill([(across, 3.51), (across + 0.045, 3.51), (across + 0.045, 3.6), (across, 3.6)], RED)
    return canvas


def age_plaster(canvas, crack_count):
    """Stains below, fallen plaster that shows brick, cracks, weathering."""
    shape = canvas.image.shape[:2]
    up = np.linspace(HEIGHT, 0, shape[0], dtype=np.float32)[:, None]
    damp = np.clip(1.5 - up + 0.6 * noise(canvas.rng, shape, 500, 4), 0, 1)
    blend(canvas, (118, 112, 84), 0.35 * damp)
    drip = noise(canvas.rng, shape[::-1], 40, 3, stretch=22).T
    blend(canvas, (108, 92, 70), 0.3 * np.clip(drip - 0.5, 0, 1) * (up < 3.3))
    fallen = noise(canvas.rng, shape, 420, 6) - 1.45
    brick = Canvas(shape[1] * RESOLUTION, HEIGHT, RESOLUTION, 11)
    stones(brick, (0, 0), (shape[1] * RESOLUTION, HEIGHT), 0.075, 0.26, (170, 98, 72))
    cover = np.clip(fallen * 40, 0, 1)[..., None]
    canvas.image += cover * (brick.image[: shape[0], : shape[1]] - canvas.image)
    blend(canvas, (92, 74, 58), np.clip(1 - np.abs(fallen) * 26, 0, 1) * 0.8)
    weather(canvas)
    cracks(canvas, crack_count, 1.3)


def paint_back(seed):
    """The back wall: saint, starry niche, annunciation."""
    canvas = paint_plaster(BACK, seed)
    for shape, width in ((SAINT, 0.085), (NICHE, 0.105), (ANNUNCIATION, 0.1)):
        canvas.fill(shape.outline(width), (214, 200, 172))
        canvas.line(shape.outline(width / 2), OCHRE, 0.02, True)
        canvas.line(shape.outline(width + 0.02), DARK_RED, 0.012, True)
    paint_saint(canvas)
    paint_niche(canvas)
    paint_annunciation(canvas)
    age_plaster(canvas, 16)
    return canvas


def paint_saint(canvas):
    """Saint with a staff in a hilly landscape."""
    shape = SAINT
    canvas.fill(shape.outline(0.0), SKY)
    area = canvas.window((shape.centre - shape.half, shape.bottom), (shape.centre + shape.half, shape.top))
    inside = shape.distance
    x = np.linspace(shape.centre - shape.half, shape.centre + shape.half, 60)
    for up, swing, colour in ((1.75, 0.1, (120, 140, 130)), (1.55, 0.07, GREEN), (1.3, 0.05, (86, 96, 54))):
        ridge = up + swing * np.sin(9 * x + 30 * up) + 0.3 * swing * np.sin(31 * x)
        canvas.fill(
            np.concatenate([np.stack([x, ridge], 1), [(x[-1], shape.bottom), (x[0], shape.bottom)]]), colour
        )
        for tree in canvas.rng.uniform(0.05, 0.95, 7):
            at = np.array([x[int(tree * 59)], ridge[int(tree * 59)]])
            canvas.line([at, np.add(at, (0, 0.06))], BROWN, 0.006)
            canvas.disc(np.add(at, (0, 0.08)), 0.03, tuple(0.7 * c for c in colour), 1.5)
    stars(canvas, (0.2, 2.05), (1.1, 2.75), 0.11, lambda points: inside(points) < -0.12)
    canvas.line([(0.36, 1.14), (0.42, 2.2)], BROWN, 0.018)
    figure(canvas, (0.64, 1.16), 1.25, (150, 60, 50), OCHRE, turn=-1)
    zigzag_border(canvas, shape.outline(0.0, 0.05), shape.outline(-0.06, 0.05))
    mottle(canvas, 0.04, 30, area)


def paint_niche(canvas):
    """Stars above, a painted curtain below."""
    shape = NICHE
    canvas.fill(shape.outline(0.0), BLUE)
    stars(canvas, (1.35, 1.7), (2.6, 2.8), 0.13, lambda points: shape.distance(points) < -0.04)
    for number, across in enumerate(
        np.arange(shape.centre - shape.half, shape.centre + shape.half - 0.01, 0.1)
    ):
        s = np.linspace(0, 1, 24)
        left = np.stack([across + 0.012 * np.sin(9 * s), 1.62 - 0.6 * s], 1)
        right = np.add(left, (0.1, 0))
        canvas.fill(np.concatenate([left, right[::-1]]), (WHITE, RED)[number % 2])
        canvas.line(np.add(left, (0.05, 0)), (PINK, DARK_RED)[number % 2], 0.012)
        for row in range(5):
            canvas.disc((across + 0.05, 1.1 + 0.11 * row), 0.02, (GREEN, CREAM)[number % 2], 1.3)
    canvas.line([(1.38, 1.63), (2.58, 1.63)], OCHRE, 0.03)
    canvas.fill([(1.38, 0.98), (2.58, 0.98), (2.58, 1.06), (1.38, 1.06)], (190, 176, 150))


def paint_annunciation(canvas):
    """An angel and a figure under an arcade, with a tiled floor in perspective."""
    left, right, low, high = 2.88, 4.32, 1.12, 2.5
    canvas.fill([(left, low), (right, low), (right, high), (left, high)], BLUE)
    stars(canvas, (left, 2.05), (3.6, high), 0.1, lambda points: points[:, 0] < 3.55)
    for row in range(8):
        near, far = 1.12 + 0.46 * (1 - 0.78**row), 1.12 + 0.46 * (1 - 0.78 ** (row + 1))
        for column in range(-14, 14):
            x = [
                3.6 + 0.12 * (column + i) * (1 - 0.75 * (z - 1.12) / 0.46)
                for z in (near, far)
                for i in (0, 1)
            ]
            quad = [(x[0], near), (x[1], near), (x[3], far), (x[2], far)]
            canvas.fill(np.clip(quad, (left, low), (right, high)), (CREAM, RED)[(row + column) % 2])
    canvas.fill([(3.62, 1.5), (right, 1.44), (right, 2.44), (3.62, 2.36)], PINK)
    canvas.fill([(3.58, 2.33), (right, 2.42), (right, 2.47), (3.58, 2.4)], OCHRE)
    for x, width in ((3.7, 0.24), (4.02, 0.26)):
        angle = np.linspace(0, np.pi, 20)
        arch = np.stack([x + width / 2 + width / 2 * np.cos(angle), 2.1 + width / 2 * np.sin(angle)], 1)
        canvas.fill(np.concatenate([arch, [(x, 1.47), (x + width, 1.47)]]), DARK_RED)
        canvas.line(arch, WHITE, 0.012)
    canvas.fill([(left, 1.5), (3.12, 1.52), (3.12, 2.1), (left, 2.14)], (198, 170, 120))
    for window in range(3):
        canvas.fill(
            [
                (2.92 + 0.06 * window, 1.8),
                (2.95 + 0.06 * window, 1.8),
                (2.95 + 0.06 * window, 1.92),
                (2.92 + 0.06 * window, 1.92),
            ],
            BROWN,
        )
    for ray in np.linspace(-0.1, 0.1, 5):
        canvas.line([(3.0, 2.44), (3.92, 1.98 + ray)], (236, 204, 120), 0.005)
    figure(canvas, (3.3, 1.26), 0.98, WHITE, PINK, turn=1, wings=True)
    figure(canvas, (4.02, 1.24), 0.98, (150, 50, 48), (36, 52, 104), turn=-1)
    for x in (3.62, 4.26):
        canvas.fill([(x - 0.02, 1.4), (x + 0.02, 1.4), (x + 0.017, 2.36), (x - 0.017, 2.36)], (222, 214, 196))
        canvas.line([(x + 0.012, 1.4), (x + 0.012, 2.36)], GREY, 0.006)
    zigzag_border(canvas, ANNUNCIATION.outline(0.0, 0.06), ANNUNCIATION.outline(-0.055, 0.06))


def paint_side(seed):
    """The side wall: window with painted voussoirs, inscribed tablet, door."""
    canvas = paint_plaster(SIDE, seed)
    angles = np.linspace(0, np.pi, 14)
    centre = np.array([WINDOW.centre, WINDOW.spring])
    for number, (a, b) in enumerate(pairwise(angles)):
        ends = [
            centre + r * np.array([np.cos(t), np.sin(t)]) for r, t in ((0.3, a), (0.5, a), (0.5, b), (0.3, b))
        ]
        canvas.fill(ends, (RED, WHITE)[number % 2])
    for number, up in enumerate(np.arange(1.98, 2.48, 0.1)):
        for side in (-1, 1):
            x = WINDOW.centre + side * np.array([0.3, 0.5])
            canvas.fill(
                [(x[0], up), (x[1], up), (x[1], up + 0.1), (x[0], up + 0.1)], (WHITE, RED)[number % 2]
            )
    canvas.fill(WINDOW.outline(0.0), (222, 212, 190))
    age_plaster(canvas, 10)
    canvas.fill(TABLET.outline(0.02), (188, 182, 170))
    canvas.line(TABLET.outline(-0.03), (120, 110, 98), 0.006, True)
    lettering(canvas, ("HANC AEDEM", "PICTVRIS", "ORNATAM", "A. D. MCDLX"), (0.34, 1.05), (1.02, 1.58))
    tablet = canvas.window((0.3, 1.0), (1.06, 1.62))
    canvas.image[tablet] = canvas.image[tablet][:, ::-1].copy()  # this wall's plane is seen from its back
    stones(canvas, (1.45, 0), (2.85, 2.0), 0.3, 0.34)
    canvas.fill(DOORWAY.outline(0.175), (190, 178, 154))
    angles = np.linspace(0, np.pi, 12)
    for angle in angles:
        direction = np.array([np.cos(angle), np.sin(angle)])
        canvas.line([(2.15, 1.7) + 0.5 * direction, (2.15, 1.7) + 0.675 * direction], (110, 98, 82), 0.007)
    paint_door(canvas)
    for low, high in (((0.2, 0.9), (1.16, 1.72)), ((1.45, 0.0), (2.85, 2.4))):
        mottle(canvas, 0.04, 50, canvas.window(low, high))
        mottle(canvas, 0.03, 6, canvas.window(low, high))
    return canvas


def paint_door(canvas):
    """Planks, iron straps and studs."""
    planks = Canvas(1.0, 2.2, RESOLUTION, 21)
    wood(planks, (0, 0), (1.0, 2.2), 0.165)
    for up in (0.35, 1.05, 1.7):
        planks.fill([(0.04, up), (0.92, up + 0.012), (0.92, up + 0.05), (0.04, up + 0.07)], (52, 48, 46))
        for x in np.arange(0.1, 0.9, 0.12):
            planks.disc((x, up + 0.034), 0.014, (92, 88, 84))
    planks.ring((0.82, 1.2), 0.05, (60, 56, 52), 0.014)
    area = canvas.window((1.65, 0), (2.65, 2.2))
    rows, columns = canvas.image[area].shape[:2]
    picture = planks.image[-rows:, :columns]
    up, across = np.mgrid[rows:0:-1, 0:columns] * RESOLUTION
    inside = DOORWAY.distance(np.stack([across.ravel() + 1.65, up.ravel()], 1)).reshape(rows, columns) < 0
    canvas.image[area][inside] = picture[inside]


def _floor(seed):
    low, high, spacing = np.array([0.0, -4.2]), np.array([5.2, 0.0]), 0.06
    counts = np.rint((high - low) / spacing).astype(int) + 1
    x, y = np.meshgrid(np.linspace(low[0], high[0], counts[0]), np.linspace(low[1], high[1], counts[1]))
    z = 0.004 * np.sin(2.1 * x + 1) * np.cos(1.7 * y)
    canvas = Canvas(5.2, 4.2, 2 * RESOLUTION, seed, (186, 172, 150))
    tile = 0.42
    for i in range(14):
        for j in range(11):
            tone = np.array((196, 184, 166) if (i + j) % 2 else (142, 92, 76)) * canvas.rng.uniform(
                0.85, 1.08
            )
            corner = np.array([i, j]) * tile
            square = corner + tile * np.array([(0.01, 0.01), (0.99, 0.01), (0.99, 0.99), (0.01, 0.99)])
            canvas.fill(square, tuple(map(float, tone)))
    marble(canvas, ((210, 200, 184), (108, 84, 72), (170, 150, 130)))
    weather(canvas, loss=1.3)
    uv = np.stack([(x - low[0]) / 5.2, (y - low[1]) / 4.2], axis=-1).reshape(-1, 2)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return Part("floor", points, uv, grid_faces(counts[1], counts[0]), canvas.finished())


def _column(seed):
    turn = np.linspace(np.pi / 2, -np.pi / 2, 7)
    torus = [(0.16 + 0.045 * np.cos(a), 0.2 + 0.045 * np.sin(-a)) for a in turn]
    shaft = [(0.15 - 0.02 * s * s, 0.27 + 2.33 * s) for s in np.linspace(0, 1, 60)]
    capital = [
        (0.145, 2.62),
        (0.165, 2.64),
        (0.15, 2.68),
        (0.17, 2.75),
        (0.22, 2.85),
        (0.27, 2.9),
        (0.27, 2.98),
        (0.0, 2.98),
    ]
    plinth = [(0.24, 0.0), (0.24, 0.06), (0.24, 0.14), (0.2, 0.15)]
    vertices, uv, faces = revolved(plinth + torus + shaft + capital, (4.72, -0.85), 48)
    canvas = Canvas(1.0, 3.0, 2 * RESOLUTION, seed, (196, 172, 150))
    marble(canvas, ((150, 96, 84), (226, 214, 200), (118, 84, 78)))
    for band in (0.26, 2.62):
        canvas.fill([(0, band), (1, band), (1, band + 0.03), (0, band + 0.03)], OCHRE)
    for across in np.arange(0, 1, 1 / 16):
        canvas.fill(
            [(across + 0.006, 2.68), (across + 0.056, 2.68), (across + 0.031, 2.9)],
            (GREEN, RED)[int(across * 16) % 2],
        )
    weather(canvas)
    return Part("column", vertices, uv, faces, canvas.finished())


def _bench(seed):
    vertices, uv, faces = box((1.3, -0.62, 0.0), (2.7, -0.2, 0.46), 0.05)
    canvas = Canvas(2.0, 2.0, 2 * RESOLUTION, seed)
    wood(canvas, (0, 0), (2, 2), 0.24, (138, 98, 62))
    return Part("bench", vertices, uv - np.floor(uv.min(axis=0)), faces, canvas.finished())
