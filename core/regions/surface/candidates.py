"""What a click on the scan may mean: frames of straight creases and grown regions, as outlines on a plane."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ...arrays import BoolArray, FloatArray, IndexArray
from ...settings import RegionSettings
from ..photo.evidence import Outlines, joined_outlines, outline_of_loop, outlines_of
from ..photo.frames import find_frames
from .creases import Creases, find_creases
from .evidence import NAMES, RING, measured
from .front import front_view
from .growing import SurfaceLevel
from .index import SurfaceIndex
from .robust_fit import SurfaceFit

_SIZE = 400  # cells along a view's side
_CELL = (0.7, 1 / 11)  # of the near view: in distances of faces, and in widths of patches, at least
_WIDER = 3.0  # how much wider the far view is
_OWN = 0.3  # share of its side below which the far view leaves a frame to the near one
_SPECK = 9.0  # square cells below which a part or hole of a region is none
_CUT = 3.0  # cells from a view's edge at which a region is cut off


@dataclass(frozen=True, eq=False)
class Candidates:
    """Outlines around a click: closed `loops` (n,2) m on `plane`, and what was measured of them (N,k).

    `level` (N,) is the number of the grown level, -1 for a frame of straight sides.
    """

    plane: SurfaceFit
    loops: list[FloatArray]
    evidence: FloatArray
    level: IndexArray


@dataclass(frozen=True, eq=False)
class FramedView:
    """`creases` of a view, and the `frames` (n,2) pixels around its middle with their `outlines` to judge."""

    creases: Creases
    frames: list[FloatArray]
    outlines: list[Outlines]


def framed_views(
    index: SurfaceIndex, plane: SurfaceFit, settings: RegionSettings, pool: Executor
) -> list[Future[FramedView]]:
    """The near view around the middle of a plane and, where the scan goes on, the far one; `pool` works."""
    cell = max(_CELL[0] * index.spacing, _CELL[1] * index.patches.width)
    near = _whole_scan(index, plane) < cell * _SIZE / 2
    # The far view first: it takes longer.
    sizes = [(cell, 0.0)] if near else [(cell * _WIDER, _OWN / _WIDER), (cell, 0.0)]
    return [pool.submit(_framed_view, index, plane, *size, settings) for size in sizes][::-1]


def _framed_view(
    index: SurfaceIndex, plane: SurfaceFit, cell: float, smallest: float, settings: RegionSettings
) -> FramedView:
    """View in cells of `cell` m, with frames larger than a share of it."""
    creases = find_creases(front_view(index, plane, cell, _SIZE, settings.colour_tolerance > 0), index.noise)
    return FramedView(creases, *_frames(creases, settings, smallest))


def find_candidates(
    index: SurfaceIndex, plane: SurfaceFit, views: Sequence[FramedView], levels: Sequence[SurfaceLevel]
) -> Candidates:
    """Frames and grown levels around the middle of a plane, seen in views of growing width."""
    left = list(range(len(levels)))
    loops: list[FloatArray] = []
    evidence: list[FloatArray] = []
    number: list[IndexArray] = []
    for view in views:
        creases, frames = view.creases, view.frames
        grown = _grown(index, creases, levels, left, view is views[-1])
        left = [k for k in left if k not in grown]
        parts = [*view.outlines, *(_outlines_of(one) for one in grown.values())]
        found = [*frames, *(one.holes for one in grown.values())]
        if not found:
            continue
        straight = np.arange(len(found)) < len(frames)
        outlines, growing = joined_outlines(parts), np.zeros((2, len(found)))
        growing[0, len(frames) :] = [levels[k].score for k in grown]
        growing[1, len(frames) :] = [one.left_out for one in grown.values()]
        evidence.append(measured(creases, outlines, straight, growing, index.noise))
        loops += [creases.view.places(loop) for loop in found]
        number.append(np.array([-1] * len(frames) + list(grown), dtype=np.int64))
    if not loops:
        return Candidates(plane, [], np.zeros((0, len(NAMES))), np.zeros(0, dtype=np.int64))
    return Candidates(plane, loops, np.concatenate(evidence), np.concatenate(number))


def _whole_scan(index: SurfaceIndex, plane: SurfaceFit) -> float:
    """How far (m) the scan reaches from the middle of a plane, along its axes."""
    return float(np.abs((index.patches.middle - plane.centre) @ plane.axes[:2].T).max())


def _frames(
    creases: Creases, settings: RegionSettings, smallest: float
) -> tuple[list[FloatArray], list[Outlines]]:
    """Frames around the middle of a view that are larger than a share of it."""
    view = creases.view
    frames = find_frames(creases.lines, view.middle, settings.least_support, settings.line_limit)
    inside = np.all((frames.corners > -_CUT) & (frames.corners < view.size + _CUT), axis=(1, 2))
    inside &= np.ptp(frames.corners, axis=1).max(axis=1) > smallest * view.size
    if not inside.any():
        return [], []
    return list(frames.corners[inside]), [outlines_of(frames.corners[inside], frames.support[inside])]


@dataclass(frozen=True, eq=False)
class _Grown:
    """Outline of a grown level: outer `loop` (n,2), the same with its `holes`, what they leave out (log)."""

    loop: FloatArray
    holes: FloatArray
    left_out: float


def _grown(
    index: SurfaceIndex, creases: Creases, levels: Sequence[SurfaceLevel], numbers: Sequence[int], last: bool
) -> dict[int, _Grown]:
    """Outlines of those grown levels that a view shows whole; of all, if it is the `last` one."""
    view = creases.view
    patch = np.where(view.face >= 0, index.patches.label[view.face], -1)
    chosen = np.zeros(len(index.patches.area) + 1, dtype=np.bool_)  # the last one: nothing seen
    found = {}
    for number in numbers:
        chosen[:] = False
        chosen[levels[number].patches] = True
        grown = _outline(chosen[patch], view.middle)
        if grown is None:
            continue
        if last or bool(np.all((grown.loop > _CUT) & (grown.loop < view.size - 1 - _CUT))):
            found[number] = grown
    return found


def _outlines_of(grown: _Grown) -> Outlines:
    """Outline to judge; around a large opening it is the region's, with the border of that."""
    outer = outline_of_loop(grown.loop)
    if grown.left_out < RING:
        return outer
    return replace(outline_of_loop(grown.holes), dented=outer.dented)


def _outline(inside: BoolArray, click: FloatArray) -> _Grown | None:
    """Outline of the part of a mask (H,W) around the click, gaps closed; None where there is none."""
    mask = cv2.morphologyEx(inside.view(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    contours, tree = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    large = [
        k for k, contour in enumerate(contours) if tree[0, k, 3] < 0 and cv2.contourArea(contour) >= _SPECK
    ]
    if not large:
        return None
    at = (float(click[0]), float(click[1]))
    outer = max(
        large, key=lambda k: min(cv2.pointPolygonTest(contours[k], at, True), 0) + 1e-6 * len(contours[k])
    )
    loop = contours[outer][:, 0].astype(np.float64)
    inner = [contours[k][:, 0].astype(np.float64) for k in np.flatnonzero(tree[0, :, 3] == outer)]
    inner = [hole for hole in inner if cv2.contourArea(hole.astype(np.float32)[:, None]) >= _SPECK]
    area, *holes = (cv2.contourArea(ring.astype(np.float32)[:, None]) for ring in (loop, *inner))
    # Holes are reached by a cut from the outline's first point: filled, the cuts have no area.
    cuts = [np.concatenate([hole, hole[:1], loop[:1]]) for hole in inner]
    return _Grown(
        loop, np.concatenate([loop, loop[:1], *cuts]), float(-np.log(max(1 - sum(holes) / area, 1e-2)))
    )
