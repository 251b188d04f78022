"""What a photo says for and against an outline around a click: a score learned from drawn facades.

An outline is judged on four sides: whether an edge runs along them, whether the photo looks different on
both sides of them, whether it looks alike from the side to the middle, and whether a like edge runs beside.
Source: boundaries by difference of colour and texture, Martin, Fowlkes and Malik, Learning to detect natural
image boundaries using local brightness, color, and texture cues, PAMI 2004.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import cv2
import numpy as np

from ...arrays import BoolArray, Float32Array, FloatArray
from ...geometry.polygons import polygon_moments
from .arches import Arches
from .edges import Gradient
from .frames import centrality

SAMPLES = 20  # places along each side
_EVERY = 2  # of these places is enough for what lies beside a side
_TEXTURE = 4.0  # pixels (sigma) over which texture is summed up
_NOISE = 0.003  # gradient of evened lightness that is noise
_STRIP = (0.08, 0.2, 0.32)  # places beside a side, in half widths of the region
_BESIDE = 12  # places beside a side where other edges are looked for
_FAR = 0.4  # of these the farthest, in half widths
_INWARDS = (0.45, 0.7, 0.9)  # places between a side and the middle

_PAST = np.linspace(0.04, 0.3, 8)  # places beyond a side's ends, in its lengths
_COVERED = 0.02  # gradient of evened lightness that is an edge
_FAINT = 0.3  # log of squared difference over spread below which two strips look alike
_SMALL, _LARGE = -9.0, -2.5  # log2 of the share of the photo beyond which regions are rare

WEIGHTS = {
    "share of the gradient that runs straight across the sides (log)": 2.66,
    "strength of the gradient across the sides (log)": -1.32,
    "strength of the gradient across the faintest side (log)": 0.02,
    "share of the least covered side that an edge covers": 15.28,
    "straight edges cover the sides (mean log)": 5.03,
    "edges go on beyond the corners": -11.76,
    "rival edge outwards of the sides": 5.21,
    "colour differs across the least distinct side": 1.86,
    "texture differs across the least distinct side": 1.92,
    "colour differs between sides and middle": -2.15,
    "texture differs between sides and middle": -1.33,
    "the click is central (log odds)": 0.72,
    "opposite sides are not parallel": -6.64,
    "outline is dented (log)": -19.98,
    "outline of like colour, not of straight lines": -3.23,
    "outline is arched": -0.33,
    "smaller than regions are (log2)": -1.03,
    "larger than regions are (log2)": -5.09,
}
"""Weights of the evidence: logistic choice among the outlines around clicks in drawn facades (carved,
fretted, plain and painted panels, windows, doors, tablets, pilasters, pediments, arched niches and openings,
discs; in light and shadow, stained). Half of the clicks are near the middle, half anywhere inside.

Mean of what `python tests/benchmarks/wand_weights.py` learned on ninety facades and, before these had arches
and pilasters, on sixty. On facades held out of three folds of the ninety, the outline that their own weights
choose has an overlap (IoU) of 0.87 in the median for clicks near the middle (mean 0.74) and 0.83 for clicks
anywhere (0.70), the best outline of all one of 0.93; the weights of the sixty reach 0.84 (0.74) and 0.83
(0.68) on the ninety.
"""

DOUBT = 1.5
"""What the scores are divided by to be log odds; facades held out are chosen alike with 1 to 2."""


@dataclass(frozen=True, eq=False)
class Look:
    """Colour (h,w,3) in noticeable steps, texture (h,w,3) as log energies along u and v and their tie, edges.

    All at half the size of the image: they are smooth.
    """

    colour: Float32Array
    texture: Float32Array
    edges: Gradient


@dataclass(frozen=True, eq=False)
class Outlines:
    """Outlines to judge: `points` and outward unit `normals` (N,4,SAMPLES,2), and (N,) pixel measures.

    `middle` (N,2) and `spread` (N,2,2) are the filled area's centroid and covariance, `half_width` its area
    over half the perimeter, `skew` how far opposite sides are from parallel (sum of sines), `dented` the log
    of its convex hull's area over its own. `beyond` (N,4,k,2) goes on straight over both ends of the
    sides, `support` (N,4) is what share of them straight edges cover; for a loop, both say nothing.
    `arched` (N,) are outlines with an arched head.
    """

    points: FloatArray
    normals: FloatArray
    middle: FloatArray
    spread: FloatArray
    area: FloatArray
    half_width: FloatArray
    skew: FloatArray
    dented: FloatArray
    beyond: FloatArray
    support: FloatArray
    arched: BoolArray


def look_of(colours: Float32Array, edges: Gradient) -> Look:
    """Colour and texture of a CIELAB image (H,W,3) with its gradient."""
    size = -(-colours.shape[1] // 2), -(-colours.shape[0] // 2)
    colour = cv2.resize(colours, size, interpolation=cv2.INTER_AREA) * np.array([0.1, 0.2, 0.2], np.float32)
    products = (edges.u * edges.u, edges.v * edges.v, edges.u * edges.v)
    along_u, along_v, tie = (
        cv2.GaussianBlur(cv2.resize(product, size, interpolation=cv2.INTER_AREA), (0, 0), _TEXTURE / 2)
        for product in products
    )
    floor = np.float32(_NOISE**2)
    texture = np.stack(
        [
            0.5 * cv2.log(along_u + floor),
            0.5 * cv2.log(along_v + floor),
            tie / cv2.sqrt((along_u + floor) * (along_v + floor)),
        ],
        axis=2,
    )
    u, v = (
        cv2.resize(part, size, interpolation=cv2.INTER_AREA).astype(np.float32) for part in (edges.u, edges.v)
    )
    return Look(colour.astype(np.float32), texture.astype(np.float32), Gradient(u, v))


def outlines_of(polygons: FloatArray, support: FloatArray) -> Outlines:
    """Outlines from quadrangles (N,4,2), of which a triangle repeats its first corner, and support (N,4)."""
    before = np.roll(polygons, 1, axis=1)
    share = 0.03 + 0.94 * (np.arange(SAMPLES) + 0.5) / SAMPLES
    vector = polygons - before
    points = before[:, :, None] + share[:, None] * vector[:, :, None]
    repeated = np.all(vector[:, 0] == 0, axis=-1)
    points[repeated, 0] = points[repeated, 1]  # the repeated corner is no side: the next one counts twice
    vector[repeated, 0] = vector[repeated, 1]
    length = np.linalg.norm(vector, axis=-1)
    turned = np.abs(vector[:, :2, 0] * vector[:, 2:, 1] - vector[:, :2, 1] * vector[:, 2:, 0])
    skew = np.where(repeated, 0.0, (turned / np.maximum(length[:, :2] * length[:, 2:], 1e-9)).sum(axis=1))
    start = np.where(repeated[:, None, None], np.roll(before, -1, axis=1), before)
    past = np.concatenate([-_PAST[::-1], 1 + _PAST])
    beyond = start[:, :, None] + past[:, None] * vector[:, :, None]
    along = np.repeat(vector[:, :, None], SAMPLES, axis=2)
    return _outlines(points, along, polygons, skew, np.zeros(len(skew)), beyond, support)


def outlines_of_arches(arches: Arches) -> Outlines:
    """Outlines from arches: first side, head, second side and foot."""
    a, b = np.moveaxis(arches.foot, 1, 0)
    c, d = arches.head[:, 0], arches.head[:, -1]
    share = 0.03 + 0.94 * (np.arange(SAMPLES) + 0.5) / SAMPLES
    straight = [
        start[:, None] + share[:, None] * (end - start)[:, None] for start, end in ((a, c), (d, b), (b, a))
    ]
    place = share * (arches.head.shape[1] - 1)
    lower = place.astype(np.int64)
    steps = np.diff(arches.head, axis=1)[:, lower]
    head = arches.head[:, lower] + (place - lower)[:, None] * steps
    ways = [np.broadcast_to(w[:, None], head.shape) for w in (c - a, b - d, a - b)]
    points = np.stack([straight[0], head, straight[1], straight[2]], axis=1)
    along = np.stack([ways[0], steps, ways[1], ways[2]], axis=1)
    beyond = np.full((len(a), 4, 2 * len(_PAST), 2), -100.0)  # sides end at the head
    beyond[:, 0, : len(_PAST)] = a[:, None] - _PAST[::-1, None] * (c - a)[:, None]
    beyond[:, 2, len(_PAST) :] = b[:, None] + _PAST[:, None] * (b - d)[:, None]
    beyond[:, 3] = b[:, None] + np.concatenate([-_PAST[::-1], 1 + _PAST])[:, None] * (a - b)[:, None]
    unit = [
        (w / np.maximum(np.linalg.norm(w, axis=1, keepdims=True), 1e-9)) for w in (c - a, b - d, a - b, c - d)
    ]
    skew = sum(np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) for u, v in (unit[:2], unit[2:]))
    outlines = _outlines(points, along, arches.loops, skew, np.zeros(len(a)), beyond, arches.support)
    return replace(outlines, arched=np.ones(len(a), dtype=np.bool_))


def outline_of_loop(loop: FloatArray) -> Outlines:
    """Outline from a closed loop (n,2), cut into four stretches of equal length."""
    closed = np.concatenate([loop, loop[:1]])
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    place = (np.arange(4 * SAMPLES) + 0.5) / (4 * SAMPLES) * run[-1]
    points = np.stack([np.interp(place, run, closed[:, k]) for k in (0, 1)], axis=1)
    vector = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    shape = (1, 4, SAMPLES, 2)
    hull = cv2.contourArea(cv2.convexHull(loop.astype(np.float32)[:, None]))
    area = max(cv2.contourArea(loop.astype(np.float32)[:, None]), 1e-9)
    dented = np.array([np.log(max(hull / area, 1.0))])
    points, vector = points.reshape(shape), vector.reshape(shape)
    beyond = np.full((1, 4, 2 * len(_PAST), 2), -100.0)  # outside the photo there is no gradient
    return _outlines(points, vector, loop[None], np.zeros(1), dented, beyond, np.ones((1, 4)))


def _outlines(
    points: FloatArray,
    along: FloatArray,
    polygons: FloatArray,
    skew: FloatArray,
    dented: FloatArray,
    beyond: FloatArray,
    support: FloatArray,
) -> Outlines:
    following = np.roll(polygons, -1, axis=1)
    cross = polygons[..., 0] * following[..., 1] - following[..., 0] * polygons[..., 1]
    signed = cross.sum(axis=1) / 2
    perimeter = np.linalg.norm(following - polygons, axis=-1).sum(axis=1)
    length = np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    outward = np.stack([along[..., 1], -along[..., 0]], axis=-1) / length
    outward *= np.where(signed < 0, -1.0, 1.0)[:, None, None, None]
    area = np.abs(signed)
    half = 2 * area / np.maximum(perimeter, 1e-9)
    middle, spread = polygon_moments(polygons)
    arched = np.zeros(len(skew), dtype=np.bool_)
    return Outlines(points, outward, middle, spread, area, half, skew, dented, beyond, support, arched)


def joined_outlines(parts: list[Outlines]) -> Outlines:
    """All outlines in one."""
    names = [field.name for field in fields(Outlines)]
    return Outlines(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def scores(
    edges: Gradient, look: Look, outlines: Outlines, click: FloatArray, straight: BoolArray
) -> FloatArray:
    """Score (N,) of N outlines around a click (2,), higher is better; `straight` (N,) are frames.

    -inf where the photo looks alike on both sides of all sides: such an outline bounds nothing.
    """
    evidence, bounds = measured(edges, look, outlines, click, straight)
    return np.where(bounds, evidence @ np.array(list(WEIGHTS.values())), -np.inf)


def measured(
    edges: Gradient, look: Look, outlines: Outlines, click: FloatArray, straight: BoolArray
) -> tuple[FloatArray, BoolArray]:
    """Evidence (N,18) in the order of `WEIGHTS`, and whether the photo looks unlike across any side (N,)."""
    inner, outer = _strip(look, outlines, -1.0), _strip(look, outlines, 1.0)
    core = _moments(look, outlines.points[:, :, ::_EVERY, None] + _towards_middle(outlines))
    step, change = _unlike(inner, outer), _unlike(inner, core)
    seen = np.column_stack([_edge_evidence(edges, look, outlines), step.min(axis=1), change.mean(axis=1)])
    evidence = np.column_stack([seen, priors(edges, outlines, click, straight)])
    bounds: BoolArray = step.max(axis=(1, 2)) >= _FAINT
    return evidence, bounds


def _edge_evidence(edges: Gradient, look: Look, outlines: Outlines) -> FloatArray:
    """What edges say (N,7), in the order of `WEIGHTS`."""
    across, total = _along_sides(edges, outlines, np.array([-1.5, 0.0, 1.5]))
    clear = np.abs(across.mean(-1))
    consistency = np.log(np.maximum((clear / total).max(axis=0), 1e-2))
    strength = np.log(clear.max(axis=0) + _NOISE)
    covered = (np.abs(across).max(axis=0) > _COVERED).mean(axis=-1)
    own = np.exp(consistency).mean(1)
    support = np.log(np.maximum(outlines.support, 0.05))
    return np.column_stack(
        [
            consistency.mean(1),
            strength.mean(1),
            strength.min(1),
            covered.min(1),
            support.mean(1),
            _going_on(edges, outlines) - own,
            _rival(look, outlines).mean(1) - own,
        ]
    )


def _going_on(edges: Gradient, outlines: Outlines) -> FloatArray:
    """How consistent (N,) the edges are that go on straight beyond the corners, mean of the eight."""
    found = edges.at(outlines.beyond).reshape(*outlines.beyond.shape[:2], 2, -1, 2)
    across = np.sum(found * outlines.normals[:, :, :1, None], axis=-1)
    total = np.sqrt(np.mean(np.sum(found * found, axis=-1), axis=-1)) + _NOISE
    going_on: FloatArray = (np.abs(across.mean(axis=-1)) / total).mean(axis=(1, 2))
    return going_on


def priors(edges: Gradient, outlines: Outlines, click: FloatArray, straight: BoolArray) -> FloatArray:
    """What is likely before the photo is looked at (N,7), for a click (2,), in the order of `WEIGHTS`."""
    share = np.log2(np.maximum(outlines.area, 1.0) / edges.u.size)
    central = centrality(outlines.middle, outlines.spread, click)
    small, large = np.maximum(_SMALL - share, 0), np.maximum(share - _LARGE, 0)
    return np.column_stack(
        [central, outlines.skew, outlines.dented, ~straight, outlines.arched, small, large]
    )


def _along_sides(
    edges: Gradient, outlines: Outlines, off: FloatArray, every: int = 1, size: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Gradient across the sides (M,N,4,k), and its whole size (M,N,4), at offsets (M,) or (M,N).

    At `every` so many of the sides' samples.
    """
    offset = off.reshape(len(off), -1, 1, 1, 1)
    normals = outlines.normals[:, :, ::every]
    found = edges.at((outlines.points[:, :, ::every] + offset * normals + 0.5) * size - 0.5)
    across = np.einsum("mnskc,nskc->mnsk", found, normals)
    total = np.sqrt(np.einsum("mnskc,mnskc->mns", found, found) / found.shape[3]) + _NOISE
    return across, total


def _rival(look: Look, outlines: Outlines) -> FloatArray:
    """How consistent (N,4) the clearest edge is that runs outside beside a side."""
    off = 3.0 + np.arange(_BESIDE)[:, None] / _BESIDE * _FAR * np.maximum(outlines.half_width, 20.0)
    across, total = _along_sides(look.edges, outlines, off, 3, 0.5)
    rival: FloatArray = (np.abs(across.mean(axis=-1)) / total).max(axis=0)
    return rival


def _towards_middle(outlines: Outlines) -> FloatArray:
    way = outlines.middle[:, None, None] - outlines.points[:, :, ::_EVERY]
    inwards: FloatArray = np.array(_INWARDS)[:, None] * way[..., None, :]
    return inwards


def _strip(look: Look, outlines: Outlines, towards: float) -> tuple[FloatArray, FloatArray]:
    depth = 3.0 + np.array(_STRIP) * outlines.half_width[:, None]
    away = (towards * depth)[:, None, None, :, None] * outlines.normals[:, :, ::_EVERY, None]
    return _moments(look, outlines.points[:, :, ::_EVERY, None] + away)


def _moments(look: Look, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and variance (N,4,6) of what is seen at places (N,4,k,depths,2)."""
    count, sides = places.shape[:2]
    flat = ((places.reshape(-1, 2) + 0.5) / 2 - 0.5).astype(np.float32)
    rows = max(1, -(-len(flat) // 16384))  # cv2.remap takes at most 32767 in a row, and at least one
    padded = np.zeros((rows * 16384, 2), dtype=np.float32)
    padded[: len(flat)] = flat
    u, v = padded.reshape(rows, 16384, 2).transpose(2, 0, 1).copy()
    seen = np.concatenate(
        [
            cv2.remap(channels, u, v, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE).reshape(-1, 3)
            for channels in (look.colour, look.texture)
        ],
        axis=1,
    )[: len(flat)].reshape(count, sides, -1, 6)
    mean = np.einsum("nskc->nsc", seen) / seen.shape[2]
    square = np.einsum("nskc,nskc->nsc", seen, seen) / seen.shape[2]
    return mean, np.maximum(square - mean * mean, 0)


def _unlike(first: tuple[FloatArray, FloatArray], second: tuple[FloatArray, FloatArray]) -> FloatArray:
    """How unlike two looks are: (N,4,2) in colour and in texture, log of squared distance over spread."""
    gap = (first[0] - second[0]) ** 2 / (first[1] + second[1] + 0.05)
    gap = gap.reshape(*gap.shape[:2], 2, 3).mean(axis=-1)
    unlike: FloatArray = np.log1p(gap)
    return unlike
