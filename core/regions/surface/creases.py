"""Creases and steps of a front view: their gradient, and the straight lines they lie on.

Pixels are those of the view; the centre of its top-left one is (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import AnyArray, BoolArray, Float32Array, FloatArray
from ...jobs import drain
from ..photo.edges import Gradient, gradient
from ..photo.lines import LineSet, find_lines_job
from .front import FrontView

_AROUND = 24.0  # pixels (sigma) over which contrast is evened out: faint creases of a smooth wall count, too
_SLOPE = 0.05  # slope below which a difference counts as noise
_NOISE = 2.0  # height below which a difference counts as noise, in noises of the scan
_LIGHTNESS = 4.0  # L* below which a difference counts as noise
_BEHIND = -2.0  # evened height where there is no surface: an opening has a border
_CONTRAST = 50.0  # grey values per unit of evened contrast
_LINES = 600  # at most


@dataclass(frozen=True, eq=False)
class Creases:
    """Creases of a view: `gradient` of what changes fastest, evened out, and straight `lines`."""

    view: FrontView
    gradient: Gradient
    lines: LineSet


def find_creases(view: FrontView, noise: float) -> Creases:
    """Creases and steps of a view of a scan whose noise is `noise` m."""
    across, up = (_evened(view.normal[:, :, axis], view.seen, _SLOPE) for axis in (0, 1))
    height = _evened(view.height, view.seen, max(_NOISE * noise, 1e-6))
    height[~view.seen] = _BEHIND
    channels = [across, up, height]
    if view.colour is not None:
        channels.append(_evened(view.colour[:, :, 0], view.seen, _LIGHTNESS))
    segments = np.concatenate([_segments(channel) for channel in channels])
    lines = drain(find_lines_job(segments, view.size, view.size, _LINES))
    return Creases(view, gradient(np.stack(channels, axis=2)), lines)


def _evened(values: Float32Array, seen: BoolArray, floor: float) -> Float32Array:
    """Values (H,H) less their local mean, in local standard deviations, 0 where nothing is seen."""
    share = seen.astype(np.float32)
    values = np.where(seen, values, np.float32(0))
    weight = _blurred(share) + np.float32(1e-3)
    offset = (values - _blurred(values) / weight) * share
    variance = np.maximum(_blurred(offset * offset) / weight, 0)
    evened: Float32Array = (offset / np.sqrt(variance + np.float32(floor**2))).astype(np.float32)
    return evened


def _blurred(values: Float32Array) -> Float32Array:
    """Mean over the neighbourhood; so wide a blur loses nothing on a quarter of the pixels' side."""
    height, width = values.shape
    coarse = cv2.resize(values, (-(-width // 4), -(-height // 4)), interpolation=cv2.INTER_AREA)
    soft = cv2.GaussianBlur(coarse, (0, 0), _AROUND / 4)
    return cv2.resize(soft, (width, height), interpolation=cv2.INTER_LINEAR).astype(np.float32)


def _segments(channel: Float32Array) -> FloatArray:
    """Straight edge segments (N,4) of an evened channel (LSD, as the photo wand's)."""
    detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD)
    levels = np.clip(channel * _CONTRAST + 128, 0, 255).astype(np.uint8)
    # typed as never None, but a view without edges has none
    segments: AnyArray | None = detector.detect(levels)[0]
    return np.zeros((0, 4)) if segments is None else np.asarray(segments, dtype=np.float64).reshape(-1, 4)
