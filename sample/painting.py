"""The sample's colours, painted by program: plaster, masonry, fresco figures, ornament, wood and marble.

A `Canvas` is a picture of a plane, in metres: `across` to the right, `up` upwards, origin at its lower left.
"""

import cv2
import numpy as np

OCHRE, RED, DARK_RED, BLUE, GREEN = (204, 158, 82), (168, 70, 52), (118, 44, 38), (42, 62, 112), (92, 112, 76)
GOLD, CREAM, SKIN, BROWN, WHITE = (
    (222, 180, 84),
    (232, 218, 188),
    (222, 178, 146),
    (96, 66, 46),
    (240, 232, 214),
)
PINK, GREY, SKY = (206, 142, 124), (150, 146, 138), (96, 126, 168)


class Canvas:
    """An RGB picture of a plane with `resolution` metres per pixel."""

    def __init__(self, length, height, resolution, seed, colour=CREAM):
        self.height, self.resolution = height, resolution
        self.rng = np.random.default_rng(seed)
        size = (round(height / resolution), round(length / resolution))
        self.image = np.empty((*size, 3), np.float32)
        self.image[:] = colour

    def pixels(self, points):
        """Points (m) -> OpenCV fixed-point pixels with 4 fractional bits."""
        points = np.asarray(points, dtype=float)
        u, v = points[..., 0] / self.resolution - 0.5, (self.height - points[..., 1]) / self.resolution - 0.5
        return np.rint(16 * np.stack([u, v], axis=-1)).astype(np.int32)

    def fill(self, points, colour):
        cv2.fillPoly(self.image, [self.pixels(points)], colour, cv2.LINE_AA, 4)

    def line(self, points, colour, width, closed=False):
        thickness = max(1, round(width / self.resolution))
        cv2.polylines(self.image, [self.pixels(points)], closed, colour, thickness, cv2.LINE_AA, 4)

    def disc(self, centre, radius, colour, aspect=1.0):
        angle = np.linspace(0, 2 * np.pi, 40)[:-1]
        self.fill(np.asarray(centre) + radius * np.stack([np.cos(angle), aspect * np.sin(angle)], 1), colour)

    def ring(self, centre, radius, colour, width):
        angle = np.linspace(0, 2 * np.pi, 48)[:-1]
        self.line(
            np.asarray(centre) + radius * np.stack([np.cos(angle), np.sin(angle)], 1), colour, width, True
        )

    def window(self, low, high):
        """Rows and columns of the rectangle from `low` to `high` (m)."""
        rows, columns = self.image.shape[:2]
        top, bottom = (int(np.clip((self.height - z) / self.resolution, 0, rows)) for z in (high[1], low[1]))
        left, right = (int(np.clip(x / self.resolution, 0, columns)) for x in (low[0], high[0]))
        return slice(top, bottom), slice(left, right)

    def finished(self):
        """The picture as uint8, (H,W,3) RGB, top row first."""
        return np.clip(np.rint(self.image), 0, 255).astype(np.uint8)


def noise(rng, shape, cell, octaves=4, stretch=1.0):
    """Fractal value noise, about [-1, 1]: `cell` is the largest wavelength in pixels, wider by `stretch`."""
    out, weight = np.zeros(shape, np.float32), 1.0
    for octave in range(octaves):
        size = max(1.5, cell / 2**octave)
        grid = rng.normal(size=(int(shape[0] / size) + 3, int(shape[1] / size / stretch) + 3)).astype(
            np.float32
        )
        big = cv2.resize(grid, None, fx=size * stretch, fy=size, interpolation=cv2.INTER_CUBIC)
        out += weight * big[: shape[0], : shape[1]]
        weight *= 0.55
    return out / 1.6


def blend(canvas, colour, amount, area=(slice(None), slice(None))):
    """Mix a colour in where `amount` (rows, columns) is above 0."""
    part = canvas.image[area]
    part += np.clip(amount, 0, 1)[..., None] * (np.asarray(colour, np.float32) - part)


def mottle(canvas, strength, cell, area=(slice(None), slice(None)), stretch=1.0):
    """Brighten and darken by fractal noise, a little differently per channel, as hand-ground pigment is."""
    part = canvas.image[area]
    common = noise(canvas.rng, part.shape[:2], cell, 5, stretch)
    for channel in range(3):
        own = noise(canvas.rng, part.shape[:2], 3 * cell, 3)
        part[..., channel] *= 1 + strength * (common + 0.14 * own)


def weather(canvas, loss=1.05, area=(slice(None), slice(None))):
    """Age a painting: brush streaks, faded patches, small losses with dark edges that show the lime."""
    shape = canvas.image[area].shape[:2]
    mottle(canvas, 0.05, 60, area)
    mottle(canvas, 0.045, 14, area, stretch=4)
    blend(canvas, (226, 214, 190), 0.22 * np.clip(noise(canvas.rng, shape, 260, 4), 0, 1), area)
    spots = noise(canvas.rng, shape, 90, 6) - loss
    blend(canvas, (120, 96, 74), np.clip(1 - np.abs(spots) * 22, 0, 1) * 0.6, area)
    blend(canvas, (224, 212, 190), np.clip(spots * 30, 0, 1), area)
    canvas.image[area] += canvas.rng.normal(0, 3.0, (*shape, 1)).astype(np.float32)


def cracks(canvas, count, length):
    """Hair cracks: random walks that turn slowly and branch, dark with a light lip."""
    rows, columns = canvas.image.shape[:2]
    extent = np.array([columns, rows]) * canvas.resolution
    for _ in range(count):
        starts = [(canvas.rng.uniform(0, 1, 2) * extent, canvas.rng.uniform(0, 2 * np.pi), length, 0.003)]
        while starts:
            point, angle, rest, width = starts.pop()
            path = [point]
            while rest > 0:
                angle += canvas.rng.normal(0, 0.35)
                point = point + 0.025 * np.array([np.cos(angle), np.sin(angle)])
                rest -= 0.025
                path.append(point)
                if canvas.rng.random() < 0.05 and len(starts) < 4:
                    starts.append((point, angle + canvas.rng.choice([-1, 1]) * 0.9, rest * 0.5, 0.0015))
            canvas.line(np.add(path, (0.0015, -0.0015)), (238, 228, 208), width)
            canvas.line(path, (88, 70, 56), width)


def ashlar(canvas, low, high, course=0.26, block=0.52):
    """Painted joints in red with a small flower in every block."""
    rows = np.arange(low[1], high[1], course)
    for number, up in enumerate(rows):
        canvas.line([(low[0], up), (high[0], up)], RED, 0.006)
        canvas.line([(low[0], up + 0.014), (high[0], up + 0.014)], PINK, 0.003)
        for across in np.arange(low[0] + (block / 2 if number % 2 else 0), high[0], block):
            canvas.line([(across, up), (across, up + course)], RED, 0.006)
            centre = np.array([across + block / 2, up + course / 2])
            turn = canvas.rng.uniform(0, 1)
            for petal in range(5):
                angle = turn + petal * 2 * np.pi / 5
                canvas.disc(centre + 0.022 * np.array([np.cos(angle), np.sin(angle)]), 0.012, RED)
            canvas.disc(centre, 0.009, OCHRE)


def stones(canvas, low, high, course, block, colour=(196, 184, 162)):
    """Cut stone in courses with mortar joints, every block of its own tone and tooling."""
    area = canvas.window(low, high)
    blend(canvas, (214, 206, 190), np.ones(canvas.image[area].shape[:2]), area)
    for number, up in enumerate(np.arange(low[1], high[1] - 1e-6, course)):
        across = low[0] - (block * canvas.rng.uniform(0.2, 0.8) if number else 0)
        while across < high[0]:
            width = block * canvas.rng.uniform(0.75, 1.25)
            tone = np.array(colour) * canvas.rng.uniform(0.82, 1.06) + canvas.rng.normal(0, 4, 3)
            corners = [
                (across, up),
                (across + width, up),
                (across + width, up + course),
                (across, up + course),
            ]
            inset = np.array([(0.006, 0.006), (-0.006, 0.006), (-0.006, -0.006), (0.006, -0.006)])
            canvas.fill(np.clip(np.array(corners) + inset, low, high), tuple(map(float, tone)))
            across += width
    mottle(canvas, 0.07, 24, area)
    mottle(canvas, 0.05, 5, area)


def zigzag_border(canvas, outline, inner, colours=(DARK_RED, CREAM, GREEN)):
    """A band between two outlines with the same number of points, filled with alternating lozenges."""
    canvas.line(inner, WHITE, 0.008, True)
    middle = 0.5 * (outline + inner)
    for i in range(0, len(outline) - 1, 2):
        j, k = (i + 1) % len(outline), (i + 2) % len(outline)
        canvas.fill([outline[i], outline[k], inner[k], inner[i]], colours[0])
        canvas.fill([middle[i], outline[j], middle[k], inner[j]], colours[1 + (i // 2) % 2])
        canvas.disc(middle[j], 0.009, RED if (i // 2) % 2 else GOLD)
    canvas.line(outline, OCHRE, 0.006, True)


def stars(canvas, low, high, step, keep):
    """Eight-pointed gold stars on a staggered grid, where `keep` (N,2) -> (N,) allows."""
    x, z = np.meshgrid(np.arange(low[0], high[0], step), np.arange(low[1], high[1], step))
    x[::2] += step / 2
    points = np.stack([x.ravel(), z.ravel()], 1) + canvas.rng.normal(0, 0.04 * step, (x.size, 2))
    for point in points[keep(points)]:
        size = 0.16 * step * canvas.rng.uniform(0.8, 1.2)
        angle = canvas.rng.uniform(0, 1) + np.arange(16) * np.pi / 8
        radius = np.where(np.arange(16) % 2, 0.4, 1.0) * size
        canvas.fill(point + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1), GOLD)


def scroll(canvas, low, high, step=0.3):
    """A vine scroll on a dark red band between two pearl strings."""
    canvas.fill([low, (high[0], low[1]), high, (low[0], high[1])], DARK_RED)
    middle, swing = 0.5 * (low[1] + high[1]), 0.3 * (high[1] - low[1])
    x = np.arange(low[0], high[0], 0.008)
    canvas.line(np.stack([x, middle + swing * np.sin(np.pi * x / step)], 1), OCHRE, 0.012)
    for number, across in enumerate(np.arange(low[0] + step / 2, high[0] - step / 3, step)):
        side = 1 if int(across / step) % 2 == 0 else -1
        turn = np.linspace(0, 2.2 * np.pi, 40)
        radius = swing * (1.05 - 0.11 * turn)
        curl = np.stack(
            [across + radius * np.cos(turn + 1.2), middle - side * 0.1 * swing + radius * np.sin(turn + 1.2)],
            1,
        )
        canvas.line(curl, GOLD, 0.009)
        for leaf in range(7):
            angle = leaf * 0.9 + number
            at = np.array([across, middle]) + 1.15 * swing * np.array([np.cos(angle), np.sin(angle)])
            canvas.disc(at, 0.017, GREEN if leaf % 2 else PINK, 1.4)
        canvas.disc((across, middle), 0.026, CREAM)
        canvas.disc((across, middle), 0.014, RED)
    for up in (low[1] + 0.02, high[1] - 0.02):
        for across in np.arange(low[0] + 0.02, high[0], 0.036):
            canvas.disc((across, up), 0.011, WHITE)


class Saint:
    """The frame a saint is drawn in: `unit` is an eighth of the height, `turn` -1 mirrors left and right."""

    def __init__(self, foot, height, turn):
        self.at = np.asarray(foot, dtype=float)
        self.unit = height / 8.0
        self.turn = turn

    def place(self, points):
        """Points in units from the foot (2,) or (N, 2), in metres on the canvas."""
        return self.at + self.unit * np.asarray(points, dtype=float) * (self.turn, 1)


ROBE = [
    (-0.9, 6.2),
    (0.8, 6.2),
    (1.0, 4.4),
    (1.25, 2.0),
    (1.5, 0.1),
    (0.4, -0.05),
    (-1.3, 0.1),
    (-1.1, 2.2),
    (-1.1, 4.4),
]
MANTLE = [(-1.0, 6.3), (0.1, 6.4), (0.7, 4.6), (0.1, 3.0), (0.9, 1.2), (-0.3, 0.7), (-1.5, 0.4), (-1.3, 3.2)]
HEM = MANTLE[:5]


def figure(canvas, foot, height, robe, mantle, turn=1, wings=False):
    """A standing saint: robe and mantle with folds, head, hair, halo; `turn` +1 looks right, -1 left."""
    saint = Saint(foot, height, turn)
    if wings:
        feathers(canvas, saint)
    clothes(canvas, saint, robe, mantle)
    canvas.fill(saint.place([(0.5, 5.5), (1.7, 4.9), (1.75, 4.6), (0.6, 4.7)]), tone(robe, 0.85))
    canvas.disc(saint.place((1.85, 4.8)), 0.24 * saint.unit, SKIN)
    head = saint.place((0.05, 7.1))
    halo(canvas, head, saint.unit)
    face(canvas, head, saint.unit, turn)


def tone(colour, factor):
    """A colour made darker or lighter."""
    return tuple(float(min(255, c * factor)) for c in colour)


def feathers(canvas, saint):
    """One wing, nine feathers in three colours."""
    for feather in range(9):
        tip = (-2.3 + 0.12 * feather, 2.6 + 0.42 * feather)
        canvas.fill(
            saint.place([(-0.5, 5.9), (-0.7, 5.3), tip, (tip[0] + 0.2, tip[1] + 0.4)]),
            (WHITE, PINK, GREEN)[feather % 3],
        )
        canvas.line(saint.place([(-0.6, 5.6), tip]), BROWN, 0.003)


def clothes(canvas, saint, robe, mantle):
    """Robe and mantle with their folds, and the mantle's golden hem."""
    canvas.fill(saint.place(ROBE), robe)
    canvas.fill(saint.place(MANTLE), mantle)
    for fold in np.linspace(-1.0, 1.15, 13):
        s = np.linspace(0, 1, 20)
        bend = np.stack([fold * (0.6 + 0.45 * s) + 0.12 * np.sin(5 * s + 4 * fold), 5.0 - 4.9 * s], 1)
        base = mantle if fold < 0 else robe
        canvas.line(saint.place(bend), tone(base, 0.62), 0.012)
        canvas.line(saint.place(np.add(bend, (0.09, 0))), tone(base, 1.3), 0.008)
    canvas.line(saint.place(HEM), GOLD, 0.012)


def halo(canvas, head, unit):
    """A golden disc with rays behind the head."""
    canvas.disc(head, 0.98 * unit, GOLD)
    for ray in np.linspace(0, 2 * np.pi, 37)[:-1]:
        direction = np.array([np.cos(ray), np.sin(ray)])
        canvas.line([head + 0.62 * unit * direction, head + 0.92 * unit * direction], OCHRE, 0.004)
    canvas.ring(head, 0.98 * unit, BROWN, 0.006)


def face(canvas, head, unit, turn):
    """Hair, face, eyes, nose and mouth."""

    def stroke(points, colour, width):
        canvas.line(head + unit * np.asarray(points) * (turn, 1), colour, width)

    canvas.disc(head, 0.58 * unit, BROWN, 1.12)
    canvas.disc(head + unit * np.array([0.1 * turn, -0.08]), 0.44 * unit, SKIN, 1.2)
    for eye in (-0.05, 0.27):
        stroke([(eye - 0.09, 0.07), (eye + 0.09, 0.07)], BROWN, 0.006)
    stroke([(0.13, 0.05), (0.2, -0.14), (0.12, -0.16)], (170, 112, 88), 0.004)
    stroke([(0.03, -0.3), (0.22, -0.3)], RED, 0.006)


def wood(canvas, low, high, plank, colour=(112, 76, 48)):
    """Vertical planks with grain, gaps and knots."""
    area = canvas.window(low, high)
    blend(canvas, colour, np.ones(canvas.image[area].shape[:2]), area)
    part = canvas.image[area]
    grain = noise(canvas.rng, part.shape[:2][::-1], 9, 4, stretch=26).T
    part *= 1 + 0.2 * grain[..., None]
    for across in np.arange(low[0], high[0], plank):
        strip = canvas.window((across, low[1]), (across + plank, high[1]))
        canvas.image[strip] *= canvas.rng.uniform(0.78, 1.12)
        canvas.line([(across, low[1]), (across, high[1])], (34, 24, 18), 0.008)
        knot = (across + plank * canvas.rng.uniform(0.3, 0.7), canvas.rng.uniform(low[1], high[1]))
        for size in (0.03, 0.022, 0.012):
            canvas.disc(knot, size, tuple(float(c * 0.55 + 400 * size) for c in colour), 1.6)


def marble(canvas, veins, colour=None):
    """Veins that follow the zero lines of warped noise."""
    shape = canvas.image.shape[:2]
    if colour is not None:
        blend(canvas, colour, np.ones(shape))
    field = noise(canvas.rng, shape, 160, 6)
    for level, tone in zip((-0.3, 0.1, 0.5), veins, strict=True):
        blend(canvas, tone, 0.75 * np.exp(-np.abs(field - level) * 26))
    mottle(canvas, 0.05, 40)


def lettering(canvas, lines, low, high):
    """Lines of cut capitals, centred between `low` and `high`."""
    step = (high[1] - low[1]) / (len(lines) + 0.5)
    scale = 0.62 * step / canvas.resolution / 22
    for number, text in enumerate(lines):
        (width, tall), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_TRIPLEX, scale, 2)
        u = 0.5 * (low[0] + high[0]) / canvas.resolution - width / 2
        v = (canvas.height - high[1] + (number + 0.75) * step) / canvas.resolution + tall / 2
        thick = max(1, round(0.004 / canvas.resolution))
        for shift, colour in ((2, (226, 218, 202)), (0, (74, 58, 48))):
            place = (round(u) + shift, round(v) + shift)
            cv2.putText(
                canvas.image, text, place, cv2.FONT_HERSHEY_TRIPLEX, scale, colour, thick, cv2.LINE_AA
            )
