"""Maps of a textured scan: a colour for every face, and the legend that says what it means."""

from __future__ import annotations

import colorsys
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from ..arrays import AnyArray, BoolArray, ByteArray, FloatArray
from ..project.stages.maps import texture_shift
from ..project.stages.textures import TexturedScan

_UNSEEN = (120, 120, 124)
_SHOWN = 40
"""Photos named in a legend at most."""


@dataclass(frozen=True, eq=False)
class FaceMap:
    """A colour for every face, (F,3) uint8 RGB, and its legend.

    `entries` are (colour, text) of single colours; `ends` the texts at the ends of the scale `scale` (N,3).
    """

    title: str
    colours: ByteArray
    entries: tuple[tuple[tuple[int, int, int], str], ...] = ()
    scale: ByteArray | None = None
    ends: tuple[str, str] = ("", "")


def photo_map(textured: TexturedScan) -> FaceMap:
    """Which photo every face uses."""
    return _photos("Photo used", textured, textured.selection.view)


def runner_up_map(textured: TexturedScan) -> FaceMap:
    """Which photo would take its place."""
    return _photos("Second best photo", textured, textured.selection.runner_up)


def count_map(textured: TexturedScan) -> FaceMap:
    """How many photos see every face."""
    count = textured.selection.view_count.astype(np.float64)
    high = max(1.0, float(count.max(initial=1.0)))
    seen = count > 0
    ends = ("1", f"{high:.0f}")
    return _scale_map("Photos that see the surface", (count - 1) / max(high - 1, 1.0), seen, ends)


def texel_map(textured: TexturedScan) -> FaceMap:
    """Size of a photo's pixel on the surface, on a logarithmic scale from its 2nd to its 98th percentile."""
    size = 1000 * textured.selection.texel_size.astype(np.float64)
    known = (textured.selection.view >= 0) & np.isfinite(size) & (size > 0)
    low, high = np.percentile(size[known], [2, 98]) if known.any() else (1.0, 1.0)
    share = np.log(np.where(known, size, low) / low) / np.log(max(high / low, 1.001))
    ends = (f"{low:.2g} mm", f"{high:.2g} mm (logarithmic)")
    return _scale_map("Size of a photo pixel on the surface", share, known, ends)


def angle_map(textured: TexturedScan) -> FaceMap:
    """Angle between viewing ray and surface normal."""
    angle = textured.selection.angle.astype(np.float64)
    ends = ("0°, straight", "90°")
    return _scale_map("Viewing angle", np.nan_to_num(angle) / 90.0, np.isfinite(angle), ends)


def blur_map(textured: TexturedScan) -> FaceMap | None:
    """Blur of the chosen photo at the face's distance; None where it was not measured."""
    return _linear("Blur of the photo", textured.selection.blur.astype(np.float64), "px", 0.5)


def shift_map(textured: TexturedScan) -> FaceMap | None:
    """How far every face's photo disagrees with its neighbours; None where nothing could be compared."""
    shift = textured.selection.predicted_shift.astype(np.float64)
    return _linear("Shift of the photo against the other photos", shift, "px", 1.0)


def pose_shift_map(textured: TexturedScan) -> FaceMap | None:
    """How far the texture may lie off, from the poses' uncertainty; None where that is not known."""
    shift = 1000 * texture_shift(textured).astype(np.float64)
    return _linear("Uncertainty of the texture’s place (σ)", shift, "mm", 0.1)


FACE_MAPS: dict[str, Callable[[TexturedScan], FaceMap | None]] = {
    "view": photo_map,
    "runner_up": runner_up_map,
    "view_count": count_map,
    "texel_size": texel_map,
    "angle": angle_map,
    "blur": blur_map,
    "predicted_shift": shift_map,
    "pose_shift": pose_shift_map,
}
"""All maps by a short name."""


def photo_colour(number: int) -> tuple[int, int, int]:
    """Colour of a photo in maps; neighbours in the list differ in hue by the golden angle."""
    lightness = (0.55, 0.42, 0.68)[number % 3]
    r, g, b = colorsys.hls_to_rgb((0.07 + 0.381966 * number) % 1.0, lightness, 0.62)
    return round(255 * r), round(255 * g), round(255 * b)


def _photos(title: str, textured: TexturedScan, number: AnyArray) -> FaceMap:
    """Colours of the photos (F,), -1 where there is none."""
    names = [view.name for view in textured.views]
    palette = np.array([*(photo_colour(n) for n in range(len(names))), _UNSEEN], dtype=np.uint8)
    shown = np.unique(number[number >= 0])
    entries = [(photo_colour(int(n)), names[n]) for n in shown[:_SHOWN]]
    return FaceMap(title, palette[number], (*entries, (_UNSEEN, "no photo")))


def _linear(title: str, values: FloatArray, unit: str, least: float) -> FaceMap | None:
    """Colours from 0 to the 98th percentile, or to `least`; None where no value is known."""
    known = np.isfinite(values)
    if not known.any():
        return None
    high = max(least, float(np.percentile(values[known], 98)))
    ends = (f"0 {unit}", f"{high:.1f} {unit}")
    return _scale_map(title, np.where(known, values, 0) / high, known, ends)


def _scale_map(title: str, share: FloatArray, known: BoolArray, ends: tuple[str, str]) -> FaceMap:
    """Colours for values (F,) in 0..1 where they are known."""
    scale = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_VIRIDIS)[:, 0, ::-1]
    colours = scale[np.rint(255 * np.clip(share, 0, 1)).astype(np.uint8)].astype(np.uint8)
    colours[~known] = _UNSEEN
    return FaceMap(title, colours, ((_UNSEEN, "not known"),), scale.astype(np.uint8), ends)
