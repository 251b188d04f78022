"""Edges of a photo as a field: how strong and in which direction, comparable all over the photo."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import BoolArray, ByteArray, Float32Array, FloatArray

NEIGHBOURHOOD = 12.0
"""Pixels over which edges are compared with their neighbours: contrast differs over a photo."""

FAINTEST = 0.01
"""Change of brightness per pixel, as a share of it, that is hardly an edge: noise is below it."""

STRONGEST = 3.0
"""An edge counts at most so many times the mean of its neighbourhood."""


@dataclass(frozen=True, eq=False)
class EdgeField:
    """Edge strength in double-angle form: `cosine`, `sine` (H,W) of twice the gradient's direction."""

    cosine: Float32Array
    sine: Float32Array

    def along(self, pixels: FloatArray, normals: FloatArray) -> FloatArray:
        """Strength (N,K) of edges across `normals` (N,2) at pixels (N,K,2); below 0 along them."""
        if len(pixels) == 0:
            return np.zeros(pixels.shape[:2])
        u = pixels[..., 0].astype(np.float32)
        v = pixels[..., 1].astype(np.float32)
        cosine = cv2.remap(self.cosine, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        sine = cv2.remap(self.sine, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        # cos 2a and sin 2a of the normal's direction a
        double_cosine = normals[:, 0] ** 2 - normals[:, 1] ** 2
        double_sine = 2 * normals[:, 0] * normals[:, 1]
        out: FloatArray = cosine * double_cosine[:, None] + sine * double_sine[:, None]
        return out


def structure_tensor(channels: Iterable[Float32Array]) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Sums of squared gradients over channels (H,W): xx, yy, xy. Source: Di Zenzo 1986."""
    products = []
    for channel in channels:
        x = cv2.Sobel(channel, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
        y = cv2.Sobel(channel, cv2.CV_32F, 0, 1, ksize=3, scale=0.125)
        products.append((x * x, y * y, x * y))
    xx, yy, xy = np.sum(products, axis=0).astype(np.float32)
    return xx, yy, xy


def photo_edge_field(photo: ByteArray, mask: BoolArray | None, scale: float = 1.0) -> EdgeField:
    """Edge field of a photo (H,W,3) at `scale` pixels; masked-out parts have no edges.

    Changes count as a share of the brightness around, so that edges in the shade count like those in the sun;
    strength is relative to the neighbourhood. Taking logarithms instead would draw edges to their dark side.
    """
    smooth: Float32Array = cv2.GaussianBlur(photo.astype(np.float32), (0, 0), scale).astype(np.float32)
    xx, yy, xy = structure_tensor(smooth[..., k] for k in range(3))
    brightness = cv2.GaussianBlur(smooth.mean(axis=2), (0, 0), NEIGHBOURHOOD) + np.float32(4.0)
    magnitude = np.sqrt(xx + yy) / brightness
    usual = cv2.GaussianBlur(magnitude, (0, 0), NEIGHBOURHOOD) + FAINTEST
    strength = np.minimum(magnitude / usual, STRONGEST)
    if mask is not None:
        usable = cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=[1.0])
        strength = strength * usable
    double_angle = np.arctan2(2 * xy, xx - yy)
    return EdgeField(strength * np.cos(double_angle), strength * np.sin(double_angle))
