"""Drawn facades with known regions, from which the photo wand learns what outlines look like.

A wall of ashlar, brick or plaster carries cornices, carved, plain and fretted panels, paintings, windows,
doors, tablets, pilasters, pediments, niches and openings with arches, and discs, as a relief in pixels and a
colour. It is stained, lit, shadowed, seen in perspective, blurred, given noise and stored as JPEG. Everything
comes from the seed.
`python tests/benchmarks/wand_facades.py` puts a sheet of twelve into artefacts/regions/facades.png.
"""

from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT = 1800, 1300  # pixels of the wall
PHOTO = (1536, 1024)
SHEET = Path(__file__).parents[2] / "artefacts" / "regions" / "facades.png"
KINDS = [
    *[*["carved"] * 5, *["fret"] * 5],
    *["plain", "painting", "window", "door", "tablet", "pediment", "pediment", "disc"],
    *[*["arch"] * 5, *["pilaster"] * 2],
]


def fractal(rng, shape, octaves=6, low=2):
    """Random field (h,w) of unit deviation, summed up over octaves."""
    out = np.zeros(shape, np.float32)
    for k in range(octaves):
        n = low * 2**k
        grid = rng.normal(size=(max(2, n * shape[0] // shape[1] + 2), n + 2)).astype(np.float32)
        out += cv2.resize(grid, shape[::-1], interpolation=cv2.INTER_CUBIC) / 1.7**k
    return out / out.std()


def filled(polygon):
    """Mask of a polygon on the wall, 1 inside."""
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.fillPoly(mask, [np.round(polygon).astype(np.int32)], 1)
    return mask


class Wall:
    """Relief (pixels), colour, and the regions drawn so far as (name, polygon)."""

    def __init__(self, rng):
        self.rng = rng
        self.relief = np.zeros((HEIGHT, WIDTH), np.float32)
        self.base = rng.uniform(70, 190) * (1 + rng.uniform(-0.08, 0.08, 3))
        self.colour = np.ones((HEIGHT, WIDTH, 3), np.float32) * self.base.astype(np.float32)
        self.regions = []
        kind = rng.choice(["ashlar", "brick", "plaster"])
        if kind != "plaster":
            self.courses(kind == "ashlar")
        self.relief += fractal(rng, (HEIGHT, WIDTH), 8, 8) * rng.uniform(0.2, 0.9)

    def courses(self, ashlar):
        """Stones or bricks with joints."""
        r = self.rng
        height = r.integers(60, 150) if ashlar else r.integers(14, 30)
        width = int(height * r.uniform(1.6, 3))
        y = row = 0
        while y < HEIGHT:
            x = -int(r.integers(0, width)) if ashlar else -(row % 2) * width // 2
            tall = int(height * (r.uniform(0.7, 1.3) if ashlar else 1))
            while x < WIDTH:
                wide = int(width * (r.uniform(0.5, 1.5) if ashlar else 1))
                stone = np.s_[y : y + tall, max(x, 0) : max(x + wide, 0)]
                self.colour[stone] *= 1 + r.normal(0, 0.07) + r.normal(0, 0.015, 3)
                self.relief[stone] += r.normal(0, 0.8)
                x += wide
                if 0 <= x < WIDTH:
                    self.joint(np.s_[y : y + tall, x : x + 2])
            y += tall
            row += 1
            self.joint(np.s_[y : y + 2])

    def joint(self, where):
        self.relief[where] -= 2
        self.colour[where] *= self.rng.uniform(0.75, 1.1)

    def cornices(self):
        r = self.rng
        for _ in range(r.integers(0, 4)):
            y = int(r.uniform(0, HEIGHT - 40))
            for _ in range(r.integers(1, 5)):
                thick = int(r.integers(3, 16))
                self.relief[y : y + thick] += r.uniform(-6, 12)
                y += thick

    def moulding(self, x, y, w, h):
        """Nested steps inwards; returns the field inside."""
        r = self.rng
        steps = int(r.integers(1, 5))
        depth = r.choice([0.35, 1.0])
        painted = r.random() < 0.2
        for _ in range(steps):
            m = int(r.integers(3, max(4, min(16, min(w, h) // 10 + 4))))
            self.relief[y : y + h, x : x + w] += depth * r.uniform(-9, 7)
            if painted:
                self.colour[y : y + h, x : x + w] = self.base * r.uniform(0.4, 1.4, 3)
            x, y, w, h = x + m, y + m, w - 2 * m, h - 2 * m
        if painted:
            self.colour[y : y + h, x : x + w] = self.base
        return x, y, w, h

    def ornament(self, x, y, w, h, once_more=True):
        """Repeated ornament in relief, sometimes with a coloured ground, sometimes over another one."""
        r = self.rng
        margin = int(min(w, h) * r.uniform(0.03, 0.12))
        wide, tall = w - 2 * margin, h - 2 * margin
        if wide < 20 or tall < 20:
            return
        soft = repeated(r, wide, tall)
        left, top = x + margin, y + margin
        place = np.s_[top : top + soft.shape[0], left : left + soft.shape[1]]
        self.relief[place] += soft * (r.uniform(4, 14) if r.random() < 0.5 else r.uniform(10, 30))
        if r.random() < 0.4:
            self.colour[place] *= 1 - (1 - soft[..., None]) * np.float32(r.uniform(0.1, 0.5))
        if r.random() < 0.35 and once_more:
            self.ornament(x, y, w, h, once_more=False)
        if r.random() < 0.3:
            self.colour[place] *= 1 + soft[..., None] * r.uniform(-0.3, 0.3)

    def rectangle(self, name, x, y, w, h):
        left, top, right, bottom = x - 0.5, y - 0.5, x + w - 0.5, y + h - 0.5
        self.regions.append((name, np.array([[left, top], [right, top], [right, bottom], [left, bottom]])))

    def element(self, x, y, w, h):
        """Draw one of the kinds into a box."""
        kind = str(self.rng.choice(KINDS))
        draw = self.panel if kind in ("carved", "plain") else getattr(self, kind)
        draw(kind, x, y, w, h)

    def panel(self, kind, x, y, w, h):
        r = self.rng
        box = np.s_[y : y + h, x : x + w]
        self.relief[box] = cv2.GaussianBlur(self.relief[box], (0, 0), 6)  # no joints of the wall
        self.colour[box] = self.base
        x, y, w, h = self.moulding(x, y, w, h)
        field = np.s_[y : y + h, x : x + w]
        if r.random() < 0.5:
            self.colour[field] *= (1 + r.normal(0, 0.15) + r.normal(0, 0.06, 3)).astype(np.float32)
        else:
            self.colour[field] *= np.float32(1 + r.normal(0, 0.03))
        if kind == "carved":
            self.ornament(x, y, w, h)
        self.rectangle(kind, x, y, w, h)

    def fret(self, kind, x, y, w, h):
        """A face with a plain border around a pattern whose ground is sunk: strapwork, tracery, grooves."""
        r = self.rng
        self.relief[y : y + h, x : x + w] = cv2.GaussianBlur(self.relief[y : y + h, x : x + w], (0, 0), 6)
        self.colour[y : y + h, x : x + w] = self.base
        x, y, w, h = self.moulding(x, y, w, h) if r.random() < 0.6 else (x, y, w, h)
        self.relief[y : y + h, x : x + w] += r.uniform(-6, 8)
        self.colour[y : y + h, x : x + w] *= np.float32(1 + r.normal(0, 0.05))
        border = int(min(w, h) * r.uniform(0.05, 0.2))
        wide, tall = w - 2 * border, h - 2 * border
        if wide >= 20 and tall >= 20:
            ground = 1 - repeated(r, wide, tall)
            top, left = y + (h - ground.shape[0]) // 2, x + (w - ground.shape[1]) // 2
            place = np.s_[top : top + ground.shape[0], left : left + ground.shape[1]]
            self.relief[place] -= ground * r.uniform(3, 14)
            tint = np.float32(r.uniform(0, 0.45)) * (1 + r.normal(0, 0.1, 3)).astype(np.float32)
            self.colour[place] *= 1 - ground[..., None] * tint
        self.rectangle(kind, x, y, w, h)

    def stains(self):
        """Water that ran down, soot, lichen: large soft patches and streaks, darker or lighter."""
        r = self.rng
        streaks = cv2.resize(fractal(r, (8, WIDTH), 7, 8), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
        patches = fractal(r, (HEIGHT, WIDTH), 5, 3)
        dark = np.clip(0.6 * patches + r.uniform(0, 0.6) * streaks - r.uniform(0.3, 1.5), 0, 1.5)
        tint = np.float32(r.uniform(0.1, 0.45)) * (1 + r.normal(0, 0.15, 3)).astype(np.float32)
        self.colour *= 1 - (dark / 1.5)[..., None] * tint

    def painting(self, kind, x, y, w, h):
        if self.rng.random() < 0.5:
            x, y, w, h = self.moulding(x, y, w, h)
        self.canvas(x, y, w, h)
        self.rectangle(kind, x, y, w, h)

    def canvas(self, x, y, w, h):
        r = self.rng
        canvas = np.ones((h, w, 3), np.float32) * r.uniform(50, 200, 3)
        for _ in range(r.integers(4, 25)):
            middle = (int(r.uniform(0, w)), int(r.uniform(0, h)))
            axes = (int(r.uniform(0.03, 0.3) * w) + 2, int(r.uniform(0.03, 0.3) * h) + 2)
            cv2.ellipse(canvas, middle, axes, r.uniform(0, 180), 0, 360, r.uniform(20, 230, 3).tolist(), -1)
        if r.random() < 0.5:
            rim = 2 * max(2, int(min(w, h) * 0.03))
            cv2.rectangle(canvas, (0, 0), (w, h), r.uniform(20, 230, 3).tolist(), rim)
        canvas *= (1 + 0.08 * fractal(r, (h, w), 5, 5))[..., None]
        self.colour[y : y + h, x : x + w] = canvas

    def window(self, kind, x, y, w, h):
        x, y, w, h = self.moulding(x, y, w, h)
        self.glass(x, y, w, h)
        self.rectangle(kind, x, y, w, h)

    def glass(self, x, y, w, h):
        r = self.rng
        field = np.s_[y : y + h, x : x + w]
        self.relief[field] = self.relief[field].mean() - r.uniform(5, 20)
        self.colour[field] = r.uniform(12, 60) * (1 + r.normal(0, 0.1, 3))
        self.colour[field] *= (1 + 0.3 * fractal(r, (h, w), 3, 2).clip(-1.5, 2))[..., None]
        if r.random() < 0.6:
            thick, upright, level = max(2, w // 40), r.integers(1, 4), r.integers(1, 5)
            shade = r.uniform(60, 220)
            for k in range(1, upright + 1):
                u = x + k * w // (upright + 1)
                self.colour[y : y + h, u - thick : u + thick] = shade
                self.relief[y : y + h, u - thick : u + thick] += 4
            for k in range(1, level + 1):
                v = y + k * h // (level + 1)
                self.colour[v - thick : v + thick, x : x + w] = shade
                self.relief[v - thick : v + thick, x : x + w] += 4

    def door(self, kind, x, y, w, h):
        x, y, w, h = self.moulding(x, y, w, h)
        self.boards(x, y, w, h)
        self.rectangle(kind, x, y, w, h)

    def boards(self, x, y, w, h):
        r = self.rng
        field = np.s_[y : y + h, x : x + w]
        self.relief[field] = self.relief[field].mean() - r.uniform(5, 20)
        self.colour[field] = r.uniform(40, 130) * np.array([1.2, 0.9, 0.65])
        boards = r.integers(3, 8)
        for k in range(1, boards):
            u = x + k * w // boards
            self.colour[y : y + h, u : u + 2] *= 0.4
            self.relief[y : y + h, u : u + 2] -= 2
        self.colour[field] *= (1 + 0.1 * cv2.resize(fractal(r, (h, 64), 4, 16), (w, h)))[..., None]

    def tablet(self, kind, x, y, w, h):
        """A slab with lines of letters cut into it."""
        r = self.rng
        x, y, w, h = self.moulding(x, y, w, h) if r.random() < 0.6 else (x, y, w, h)
        self.relief[y : y + h, x : x + w] += r.uniform(3, 10)
        self.colour[y : y + h, x : x + w] = r.uniform(60, 220) * (1 + r.normal(0, 0.05, 3))
        count = r.integers(3, 9)
        line = h / (count + 1)
        depth = float(self.relief[y + h // 2, x + 1] - 2)
        for k in range(count):
            u, top, bottom = x + w * 0.08, int(y + (k + 0.7) * line), int(y + (k + 1.2) * line)
            while u < x + w * 0.88:
                wide = line * r.uniform(0.25, 0.5)
                cv2.rectangle(self.relief, (int(u), top), (int(u + wide * 0.3), bottom), depth, -1)
                self.colour[top:bottom, int(u) : int(u + wide * 0.5)] *= 0.6
                u += wide + line * 0.15
        self.rectangle(kind, x, y, w, h)

    def pediment(self, kind, x, y, w, h):
        r = self.rng
        tall = min(h, int(w * r.uniform(0.25, 0.5)))
        triangle = np.array([[x, y + tall], [x + w / 2, y], [x + w, y + tall]], float)
        middle = triangle.mean(axis=0)
        for _ in range(r.integers(1, 4)):
            self.relief += filled(triangle) * np.float32(r.uniform(-9, 7))
            triangle = middle + (triangle - middle) * r.uniform(0.86, 0.95)
        field = filled(triangle)
        self.relief -= field * np.float32(r.uniform(3, 9))
        if r.random() < 0.5:
            before = self.relief.copy()
            low, high = triangle.min(axis=0).astype(int), triangle.max(axis=0).astype(int)
            self.ornament(*low, *(high - low))
            inner = cv2.erode(field, np.ones((9, 9))) > 0
            self.relief = np.where(inner, self.relief, before)
        self.regions.append((kind, triangle))

    def arch(self, kind, x, y, w, h):
        """A niche, window, door or painting with an arched head, in bands that follow it."""
        r = self.rng
        wide = int(min(w * r.uniform(0.6, 0.98), h * r.uniform(0.4, 0.95)))
        x, w = x + (w - wide) // 2, wide
        shape = r.choice(["round", "round", "pointed", "segmental"])
        band, count = int(r.integers(3, max(4, min(18, w // 12 + 4)))), int(r.integers(0, 4))
        down = 1 if r.random() < 0.5 else 0  # bands go round the foot, or end on it
        painted = r.random() < 0.3
        if r.random() < 0.4 and count:
            self.voussoirs(arched(shape, x, y, w, h), band)
        for _ in range(count):
            ring = filled(arched(shape, x, y, w, h))
            self.relief += ring * np.float32(r.choice([0.35, 1.0]) * r.uniform(-9, 7))
            if painted:
                tone = self.base * r.uniform(0.4, 1.4, 3)
                self.colour = np.where(ring[..., None] > 0, tone, self.colour)
            x, y, w, h = x + band, y + band, w - 2 * band, h - (1 + down) * band
            band = max(3, int(band * r.uniform(0.5, 1.6)))
            if min(w, h) < 40:
                break
        outline = arched(shape, x, y, w, h)
        before = self.relief.copy(), self.colour.copy()
        box = np.s_[y : y + h, x : x + w]
        if r.random() < 0.6:  # no joints of the wall
            self.relief[box] = cv2.GaussianBlur(self.relief[box], (0, 0), 6)
            self.colour[box] = self.base
        getattr(self, str(r.choice(["glass", "boards", "canvas", "recess", "recess", "ornament"])))(
            x, y, w, h
        )
        inside = filled(outline) > 0
        self.relief = np.where(inside, self.relief, before[0]).astype(np.float32)
        self.colour = np.where(inside[..., None], self.colour, before[1]).astype(np.float32)
        self.regions.append((kind, outline))

    def voussoirs(self, outline, band):
        """Joints that run off from an arched outline, and its stones' own tones."""
        r = self.rng
        middle = outline.mean(axis=0)
        outer = middle + (outline - middle) * (1 + 2 * band / np.ptp(outline, axis=0).min())
        for k in range(1, len(outline) - 3, 2):
            stone = np.array([outer[k], outer[k + 2], middle])
            where = filled(stone) > 0
            self.colour[where] *= 1 + r.normal(0, 0.07)
            ends = np.round([outer[k], outline[k]]).astype(int).tolist()
            cv2.line(self.relief, ends[0], ends[1], float(self.relief.min()), 1)

    def recess(self, x, y, w, h):
        """A niche: sunk, shaded from the top, with a field of another tone and a skirting below."""
        r = self.rng
        field = np.s_[y : y + h, x : x + w]
        self.relief[field] -= r.uniform(3, 20)
        tone = r.uniform(0.25, 1.2) * (1 + r.normal(0, 0.12, 3))
        self.colour[field] *= tone.astype(np.float32)
        self.colour[field] *= np.linspace(r.uniform(0.5, 1), 1, h, dtype=np.float32)[:, None, None]
        if r.random() < 0.5:
            skirting = np.s_[y + int(h * r.uniform(0.5, 0.85)) : y + h, x : x + w]
            self.colour[skirting] *= r.uniform(0.5, 1.5, 3).astype(np.float32)

    def pilaster(self, kind, x, y, w, h):
        """A shaft, fretted, fluted or plain, between a capital and a base that are wider, in steps."""
        r = self.rng
        self.relief[y : y + h, x : x + w] = cv2.GaussianBlur(self.relief[y : y + h, x : x + w], (0, 0), 6)
        self.colour[y : y + h, x : x + w] = self.base
        shaft = int(min(w, h * r.uniform(0.1, 0.3)))
        left, high = x + (w - shaft) // 2, r.uniform(4, 14)
        ends = [int(h * r.uniform(0.05, 0.15)) for _ in range(2)]
        steps = r.integers(2, 6, 2)
        for start, tall, count, way in ((y, ends[0], steps[0], -1), (y + h - ends[1], ends[1], steps[1], 1)):
            for k in range(count):
                out = int((k if way > 0 else count - 1 - k) * shaft * 0.08) + int(r.integers(0, 5))
                rows = np.s_[start + k * tall // count : start + (k + 1) * tall // count]
                self.relief[rows, max(left - out, 0) : left + shaft + out] += high + r.uniform(0, 9)
        top, tall = y + ends[0], h - sum(ends)
        self.relief[top : top + tall, left : left + shaft] += high
        self.colour[top : top + tall, left : left + shaft] *= np.float32(1 + r.normal(0, 0.05))
        border = max(3, int(shaft * r.uniform(0.08, 0.25)))
        inner = (left + border, top + border, shaft - 2 * border, tall - 2 * border)
        look = r.choice(["fret", "flutes", "plain"])
        if look == "fret" and min(inner[2:]) > 20:
            ground = 1 - repeated(r, *inner[2:])
            place = np.s_[inner[1] : inner[1] + ground.shape[0], inner[0] : inner[0] + ground.shape[1]]
            self.relief[place] -= ground * r.uniform(3, 12)
            self.colour[place] *= 1 - ground[..., None] * np.float32(r.uniform(0, 0.3))
        elif look == "flutes" and min(inner[2:]) > 20:
            wave = np.cos(np.linspace(0, 2 * np.pi * r.integers(3, 8), inner[2])).astype(np.float32)
            self.relief[inner[1] : inner[1] + inner[3], inner[0] : inner[0] + inner[2]] += 4 * wave
        self.rectangle(kind, left, top, shaft, tall)

    def disc(self, kind, x, y, w, h):
        angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
        rim = min(w, h) * 0.4 * np.stack([np.cos(angle), np.sin(angle)], 1)
        self.curved(kind, np.array([x + w / 2, y + h / 2]) + rim)

    def curved(self, kind, outline):
        r = self.rng
        middle = outline.mean(axis=0)
        for grow in (r.uniform(1.05, 1.2), 1.0):
            self.relief += filled(middle + (outline - middle) * grow) * np.float32(r.uniform(-10, 8))
        tint = np.float32(r.uniform(0.2, 1.3)) * (1 + r.normal(0, 0.1, 3)).astype(np.float32)
        self.colour = np.where(filled(outline)[..., None] > 0, self.colour * tint, self.colour)
        self.regions.append((kind, outline))


def arched(shape, x, y, w, h):
    """Outline (n,2) of an upright box with an arched head, from the left spring over the head to the foot."""
    across = np.sin(np.linspace(-np.pi / 2, np.pi / 2, 41))
    if shape == "round":
        rise, head = 0.5, np.sqrt(1 - across**2)
    elif shape == "pointed":
        rise, head = 0.866, np.sqrt((4 - (np.abs(across) + 1) ** 2) / 3)
    else:
        rise, head = 0.2, (np.sqrt(2.1 - across**2) - np.sqrt(1.1)) / (np.sqrt(2.1) - np.sqrt(1.1))
    rise = min(rise * w, 0.8 * h)
    top = np.stack([x + w * (1 + across) / 2, y + rise * (1 - head)], axis=1)
    return np.concatenate([top, [[x + w, y + h], [x, y + h]]]) - 0.5


def repeated(r, wide, tall):
    """Motifs side by side along the longer side of a box, 1 where they stand out, with soft edges."""
    count = max(1, round(max(wide, tall) / min(wide, tall) / r.uniform(0.8, 2)))
    size = (wide // count, tall) if wide > tall else (wide, tall // count)
    tile = motif(r, *size)
    full = np.tile(tile, (1, count) if wide > tall else (count, 1)).astype(np.float32)
    return cv2.GaussianBlur(full, (0, 0), r.uniform(0.8, 3))


def motif(r, wide, tall):
    """One ornament, 1 where it stands out."""
    tile = np.zeros((tall, wide), np.uint8)
    least, middle = min(wide, tall), (wide // 2, tall // 2)
    kind = r.choice(["vine", "rosette", "blobs", "cross"])
    thick = max(2, int(least * r.uniform(0.04, 0.12)))
    if kind == "vine":
        for _ in range(r.integers(3, 9)):
            knots = np.cumsum(r.normal(0, least * 0.13, (6, 2)), 0) + r.uniform(0, 1, 2) * (wide, tall)
            run = np.linspace(0, 5, 30)
            stem = np.stack([np.interp(run, np.arange(6), knots[:, k]) for k in (0, 1)], 1)
            stem = cv2.GaussianBlur(stem.astype(np.float32), (1, 7), 2).astype(np.int32)
            cv2.polylines(tile, [stem], False, 1, thick)
            cv2.circle(tile, tuple(stem[-1].tolist()), thick * 2, 1, -1)
    elif kind == "rosette":
        radius = int(least * r.uniform(0.25, 0.45))
        cv2.circle(tile, middle, radius, 1, thick)
        for k in range(r.integers(4, 9)):
            leaf = np.array(middle) + radius * 0.5 * np.array([np.cos(k * np.pi / 3), np.sin(k * np.pi / 3)])
            cv2.circle(tile, tuple(leaf.astype(int).tolist()), max(2, radius // 4), 1, -1)
    elif kind == "blobs":
        tile = (fractal(r, (tall, wide), 4, 3) > r.uniform(0, 0.6)).astype(np.uint8)
    else:
        cv2.rectangle(tile, (middle[0] - thick, 0), (middle[0] + thick, tall), 1, -1)
        cv2.rectangle(tile, (0, middle[1] - thick), (wide, middle[1] + thick), 1, -1)
        cv2.circle(tile, middle, int(least * 0.25), 1, -1)
    if r.random() < 0.7:
        tile = np.maximum(tile, tile[:, ::-1])
    if r.random() < 0.4:
        tile = np.maximum(tile, tile[::-1])
    if r.random() < 0.3:  # bars between the repeats
        tile[:, : thick // 2 + 1] = tile[:, -(thick // 2 + 1) :] = 1
    if r.random() < 0.2:
        cv2.rectangle(tile, (wide // 5, tall // 5), (wide * 4 // 5, tall * 4 // 5), 1, thick)
    return tile


def lit(wall, rng):
    """Wall in sun and sky light: slopes, cast shadows, shade of a building or of trees, dark recesses."""
    relief = cv2.GaussianBlur(wall.relief, (0, 0), 0.8)
    azimuth, height = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(25, 65))
    sun = np.array([np.cos(azimuth), -abs(np.sin(azimuth)), np.tan(height)]) * np.cos(height)
    along_u = cv2.Sobel(relief, cv2.CV_32F, 1, 0, scale=0.125)
    along_v = cv2.Sobel(relief, cv2.CV_32F, 0, 1, scale=0.125)
    steep = np.sqrt(along_u**2 + along_v**2 + 1)
    slope = np.clip((-along_u * sun[0] - along_v * sun[1] + sun[2]) / steep, 0, None)
    shadow = np.zeros_like(relief)
    for far in 1.5 * np.arange(1, 16):
        shift = np.float32([[1, 0, -sun[0] / np.cos(height) * far], [0, 1, -sun[1] / np.cos(height) * far]])
        moved = cv2.warpAffine(relief, shift, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE)
        shadow = np.maximum(shadow, np.clip(moved - far * np.tan(height) - relief, 0, 1))
    strength = rng.choice([0, rng.uniform(0.2, 0.5), rng.uniform(0.5, 0.9)])
    direct = slope * (1 - cv2.GaussianBlur(shadow, (0, 0), 1))
    if rng.random() < 0.35:
        shade = np.zeros((HEIGHT, WIDTH), np.float32)
        corners = rng.uniform([-0.2 * WIDTH, -0.2 * HEIGHT], [1.2 * WIDTH, 1.2 * HEIGHT], (4, 2))
        cv2.fillConvexPoly(shade, cv2.convexHull(corners.astype(np.int32)), 1)
        direct *= 1 - cv2.GaussianBlur(shade, (0, 0), rng.uniform(1, 12))
    if rng.random() < 0.25:
        leaves = (fractal(rng, (HEIGHT, WIDTH), 6, 6) > 0.8).astype(np.float32)
        direct *= np.clip(1 - cv2.GaussianBlur(leaves, (0, 0), 3), 0, 1)
    recess = 1 + np.clip((relief - cv2.GaussianBlur(relief, (0, 0), 8)) * 0.03, -0.45, 0.15)
    ambient = recess * (0.55 + 0.45 * (0.5 * along_v + 0.85) / steep)
    light = (1 - strength) * ambient + strength * direct * 1.6
    light *= 1 + 0.1 * fractal(rng, (HEIGHT, WIDTH), 2, 2)
    return wall.colour * light[..., None].clip(0.05, None)


def built(rng):
    """Wall with rows of elements, sometimes alike, sometimes not."""
    wall = Wall(rng)
    wall.cornices()
    rows = rng.integers(1, 4)
    bounds = np.linspace(60, HEIGHT - 60, rows + 1)
    for upper, lower in pairwise(bounds):
        count = rng.choice([1, 2, 3, 4, 6, 9])
        columns = np.linspace(80, WIDTH - 80, count + 1)
        top, bottom = upper + rng.uniform(5, 60), lower - rng.uniform(5, 60)
        if rng.random() < 0.35:
            bottom = top + (bottom - top) * rng.uniform(0.2, 0.5)
        gap = rng.uniform(6, 70)
        same = rng.random() < 0.6
        for left, right in zip(columns[:-1] + gap / 2, columns[1:] - gap / 2, strict=True):
            t, b = (top, bottom) if same else (top + rng.uniform(0, 60), bottom - rng.uniform(0, 60))
            if right - left < 60 or b - t < 60:
                continue
            narrow = rng.random() < 0.5 and right - left > 250 and not same
            wide = (right - left) * (rng.uniform(0.4, 0.9) if narrow else 1.0)
            wall.element(int(left), int(t), int(wide), int(b - t))
    if rng.random() < 0.5:
        wall.stains()
    return wall


def view(rng):
    """Homography (3,3) from the wall to the photo."""
    corners = np.float32([[0, 0], [WIDTH, 0], [WIDTH, HEIGHT], [0, HEIGHT]])
    off = rng.uniform(-0.14, 0.14, (4, 2)) * (WIDTH, HEIGHT)
    roll = rng.normal(0, 0.03)
    turn = np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
    seen = ((corners + off - (WIDTH / 2, HEIGHT / 2)) @ turn.T) * rng.uniform(0.75, 1.05) * 0.84
    return cv2.getPerspectiveTransform(corners, (seen + np.array(PHOTO) / 2).astype(np.float32))


def facade(seed):
    """Photo (H,W,3) uint8 and its regions as (name, outline (n,2)), of those that it shows whole."""
    rng = np.random.default_rng(seed)
    wall = built(rng)
    surface = lit(wall, rng)
    surface *= 1 + rng.uniform(0.01, 0.05) * rng.normal(size=(HEIGHT, WIDTH, 1)).astype(np.float32)
    seen = view(rng)
    sky = np.ones((PHOTO[1], PHOTO[0], 3), np.float32) * rng.uniform(100, 240, 3).astype(np.float32)
    sky *= np.linspace(1.1, 0.9, PHOTO[1], dtype=np.float32)[:, None, None]
    surface = np.ascontiguousarray(surface, np.float32)
    cover = cv2.warpPerspective(np.ones((HEIGHT, WIDTH), np.float32), seen, PHOTO)[..., None]
    image = cv2.warpPerspective(surface, seen, PHOTO, flags=cv2.INTER_AREA) + sky * (1 - cover)
    if rng.random() < 0.3:  # a pole or cable before the wall
        ends = rng.uniform([0, 0], PHOTO, (2, 2)).astype(int).tolist()
        cv2.line(image, ends[0], ends[1], rng.uniform(10, 200, 3).tolist(), int(rng.integers(2, 14)))
    image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.3, 1.1))
    toned = 255 * (np.clip(image, 0, 255) / 255) ** rng.uniform(0.8, 1.2)
    noisy = np.clip(toned + rng.normal(0, rng.uniform(1, 5), toned.shape), 0, 255).astype(np.uint8)
    stored = cv2.imencode(".jpg", noisy, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(75, 96))])[1]
    regions = []
    for name, polygon in wall.regions:
        outline = cv2.perspectiveTransform(polygon[None].astype(np.float32), seen)[0].astype(float)
        if outline.min() >= 5 and np.all(outline <= np.array(PHOTO) - 6):
            regions.append((name, outline))
    return cv2.imdecode(stored, cv2.IMREAD_COLOR), regions


def main():
    tiles = []
    for seed in range(12):
        image, regions = facade(seed)
        for _, outline in regions:
            cv2.polylines(image, [np.round(outline).astype(np.int32)], True, (0, 255, 0), 2)
        tiles.append(cv2.resize(image, None, fx=0.3, fy=0.3, interpolation=cv2.INTER_AREA))
    SHEET.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(SHEET), np.vstack([np.hstack(tiles[k : k + 4]) for k in range(0, 12, 4)]))


if __name__ == "__main__":
    main()
