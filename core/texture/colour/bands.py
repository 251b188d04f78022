"""Multi-band blending: photos are taken apart into octaves that cross-fade the wider the coarser they are.

A wide cross-fade hides a step of colour but shows fine detail twice where photos do not meet to the pixel; a
narrow one keeps the detail but shows the step. So detail fades over one ring of faces, and every octave below
over twice as many. Source: Burt and Adelson 1983, with the surface in place of the image plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from ...arrays import AnyArray, BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from ...geometry.meshes import edge_pairs
from ...photos.view import View
from ..selection import Selection
from ..views.images import read_deep_photo, sample_image, to_linear
from .blending import blend_shares
from .levelling import SeamLevels

_PER_RING = 0.5
"""Blur (sigma) of what fades over a number of rings, in widths of these: half a wavelength or less fades."""
_FINEST = 2.0
"""Smallest blur, in texels, that makes a band of its own."""
_SCALES = 1 / 128, 1 / 2
"""Factors between which a photo is reduced for a band: to a handful of pixels at least, to half at most."""
_REDUCED = 0.7
"""A photo whose pixels are this much smaller than the texels is reduced to these before it is sampled."""


@dataclass(frozen=True, eq=False)
class BandMix:
    """What goes into every face: photo `view` (N,) on `face` (N,), sorted by face.

    `share` (B,N,3) are its shares at the corners in each band, the finest first; `factor` (N,3,3) the linear
    RGB factors there that level the seams. `scale` (B-1,V) reduces each photo to the band's lower end, the
    same on the surface whatever the photo's resolution.
    """

    face: IndexArray
    view: IntArray
    share: Float32Array
    factor: Float32Array | None
    scale: FloatArray

    @cached_property
    def alone(self) -> BoolArray:
        """Entries (N,) whose photo has its face for itself in all bands."""
        whole: BoolArray = (self.share == 1).all(axis=(0, 2))
        return whole


def mix_bands(
    points: FloatArray,
    faces: IntArray,
    selection: Selection,
    views: Sequence[View],
    rings: int,
    levels: SeamLevels | None,
) -> BandMix:
    """Shares of the photos in every band of a textured mesh (V,3) m, (F,3).

    The lowest band fades over `rings` rings of faces on either side of a seam; 0 blends nothing.
    """
    usual = float(np.nanmedian(selection.texel_size)) if (selection.view >= 0).any() else 1.0
    ring = _edge_length(points, faces)
    widths = _band_rings(rings, ring / usual)
    blend = blend_shares(points, faces, selection.view, views, widths)
    factor = levels.at(blend.view[:, None], faces[blend.face]) if levels is not None else None
    scale = np.array([_scales(selection, len(views), _PER_RING * number * ring) for number in widths[1:]])
    return BandMix(blend.face, blend.view, blend.share, factor, scale.reshape(len(widths) - 1, len(views)))


def _edge_length(points: FloatArray, faces: IntArray) -> float:
    """Median length (m) of the mesh's edges, 0 without any: a ring of faces is about as wide."""
    ends = points[edge_pairs(faces, len(points)).vertex]
    return float(np.median(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1))) if len(ends) else 0.0


def _band_rings(rings: int, texels: float) -> list[int]:
    """Rings over which the bands fade, finest first: 1, ..., rings / 2, rings; a ring is `texels` wide."""
    widths = []
    while rings > 1 and _PER_RING * rings * texels >= _FINEST:
        widths.append(rings)
        rings //= 2
    return [min(rings, 1) if widths else rings, *reversed(widths)]


def _scales(selection: Selection, view_count: int, blur: float) -> FloatArray:
    """Factor that makes pixels of each photo `blur` m large on the surface where it is used."""
    scales = np.ones(view_count)
    for number in np.unique(selection.view[selection.view >= 0]):
        own = float(np.median(selection.texel_size[selection.view == number]))
        scales[number] = np.clip(own / blur, *_SCALES)
    return scales


@dataclass(frozen=True, eq=False)
class PhotoBands:
    """A photo (H,W,3), reduced by `scale`, with its gain; and reduced to the `lower` ends of its bands."""

    full: AnyArray
    scale: float
    lower: tuple[Float32Array, ...]
    lower_scale: FloatArray
    gain: Float32Array

    @classmethod
    def of_photo(
        cls, view: View, number: int, gain: FloatArray, lower_scale: FloatArray, scale: float
    ) -> PhotoBands:
        """Read a photo; a `scale` well below 1 reduces it to the atlas's texels, lest it alias."""
        full = read_deep_photo(view, number)
        lower_scale = np.maximum(lower_scale, 1 / min(full.shape[:2]))
        lower: list[Float32Array] = []
        if len(lower_scale):
            widest = float(lower_scale.max())
            small = to_linear(cv2.resize(full, None, fx=widest, fy=widest, interpolation=cv2.INTER_AREA))
            for share in (lower_scale / widest).tolist():
                reduced = cv2.resize(small, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
                lower.append(cv2.GaussianBlur(reduced, (0, 0), 1.0).astype(np.float32, copy=False))
        if scale < _REDUCED:
            full = cv2.resize(full, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        else:
            scale = 1.0
        return cls(full, scale, tuple(lower), lower_scale, gain.astype(np.float32))

    def whole(self, pixels: FloatArray) -> Float32Array:
        """All bands together at pixels (n,2): linear (n,3)."""
        colour: Float32Array = to_linear(
            sample_image(self.full, (pixels + 0.5) * self.scale - 0.5, cubic=True)
        )
        colour *= self.gain
        return colour

    def mixed(self, pixels: FloatArray, share: Float32Array) -> Float32Array:
        """Bands weighted by their shares: (n,2), (B,n) -> linear (n,3).

        Band b is what lies between lower ends b - 1 and b, so each of these counts by the change of shares.
        """
        colour = self.whole(pixels) * share[0, :, None]
        for band, (image, scale) in enumerate(zip(self.lower, self.lower_scale, strict=True)):
            change = (share[band + 1] - share[band])[:, None] * self.gain
            colour += sample_image(image, (pixels + 0.5) * scale - 0.5) * change
        return colour
