"""Colours as they are seen: CIE L*a*b* (D50) of linear sRGB, and the difference CIEDE2000."""

from __future__ import annotations

import numpy as np

from ...arrays import ArrayLike, FloatArray

_XYZ_OF_RGB = np.array(
    [
        [0.4360747, 0.3850649, 0.1430804],
        [0.2225045, 0.7168786, 0.0606169],
        [0.0139322, 0.0971045, 0.7141733],
    ]
)
"""Linear sRGB (D65) to XYZ under D50, adapted by Bradford."""
_WHITE = np.array([0.96422, 1.0, 0.82521])
_EPSILON, _KAPPA = 216 / 24389, 24389 / 27


def linear_to_lab(linear: ArrayLike) -> FloatArray:
    """L*a*b* (D50) of linear sRGB, white 1: (...,3) -> (...,3). Source: CIE 15:2004, 8.2.1."""
    xyz = np.asarray(linear, dtype=np.float64) @ _XYZ_OF_RGB.T / _WHITE
    f = np.where(xyz > _EPSILON, np.cbrt(np.maximum(xyz, 0)), (_KAPPA * xyz + 16) / 116)
    x, y, z = f[..., 0], f[..., 1], f[..., 2]
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def lab_to_linear(lab: ArrayLike) -> FloatArray:
    """Linear sRGB of L*a*b* (D50), not clipped: (...,3) -> (...,3)."""
    values = np.asarray(lab, dtype=np.float64)
    y = (values[..., 0] + 16) / 116
    f = np.stack([y + values[..., 1] / 500, y, y - values[..., 2] / 200], axis=-1)
    xyz = np.where(f**3 > _EPSILON, f**3, (116 * f - 16) / _KAPPA) * _WHITE
    linear: FloatArray = xyz @ np.linalg.inv(_XYZ_OF_RGB).T
    return linear


def colour_difference(lab1: ArrayLike, lab2: ArrayLike) -> FloatArray:
    """Difference CIEDE2000 of L*a*b* colours: (...,3), (...,3) -> (...). About 1 is just visible.

    Source: Sharma, Wu and Dalal 2005, eq. 2 to 22.
    """
    one, two = np.asarray(lab1, dtype=np.float64), np.asarray(lab2, dtype=np.float64)
    mean_chroma = 0.5 * (np.hypot(one[..., 1], one[..., 2]) + np.hypot(two[..., 1], two[..., 2]))
    stretch = 1.5 - 0.5 * np.sqrt(mean_chroma**7 / (mean_chroma**7 + 25.0**7))
    c1, h1 = _chroma_and_hue(one, stretch)
    c2, h2 = _chroma_and_hue(two, stretch)
    grey = c1 * c2 == 0
    turn = np.where(grey, 0.0, (h2 - h1 + np.pi) % (2 * np.pi) - np.pi)
    hue = np.where(grey, h1 + h2, _mean_hue(h1, h2))
    light, chroma = 0.5 * (one[..., 0] + two[..., 0]), 0.5 * (c1 + c2)
    t = (
        1
        - 0.17 * np.cos(hue - np.radians(30))
        + 0.24 * np.cos(2 * hue)
        + 0.32 * np.cos(3 * hue + np.radians(6))
        - 0.20 * np.cos(4 * hue - np.radians(63))
    )
    scale_l = 1 + 0.015 * (light - 50) ** 2 / np.sqrt(20 + (light - 50) ** 2)
    d_l = (two[..., 0] - one[..., 0]) / scale_l
    d_c = (c2 - c1) / (1 + 0.045 * chroma)
    d_h = 2 * np.sqrt(c1 * c2) * np.sin(turn / 2) / (1 + 0.015 * chroma * t)
    angle = np.radians(60) * np.exp(-(((np.degrees(hue) - 275) / 25) ** 2))
    rotation = -2 * np.sqrt(chroma**7 / (chroma**7 + 25.0**7)) * np.sin(angle)
    difference: FloatArray = np.sqrt(np.maximum(d_l**2 + d_c**2 + d_h**2 + rotation * d_c * d_h, 0))
    return difference


def _chroma_and_hue(lab: FloatArray, stretch: FloatArray) -> tuple[FloatArray, FloatArray]:
    a = lab[..., 1] * stretch
    return np.hypot(a, lab[..., 2]), np.arctan2(lab[..., 2], a) % (2 * np.pi)


def _mean_hue(h1: FloatArray, h2: FloatArray) -> FloatArray:
    """Middle of two angles in [0, 2 pi), on their nearer side."""
    total = h1 + h2
    far = np.abs(h1 - h2) > np.pi
    mean: FloatArray = 0.5 * np.where(
        far, np.where(total < 2 * np.pi, total + 2 * np.pi, total - 2 * np.pi), total
    )
    return mean
