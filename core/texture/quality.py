"""How well a picture of the model agrees with a photo: PSNR, SSIM, exposure, sub-pixel shift.

All functions compare two (H,W,3) uint8 RGB images over the pixels where `covered` (H,W) is true.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from ..arrays import BoolArray, ByteArray, Float32Array, FloatArray
from ..errors import TextureError

_SSIM_SIGMA = 1.5
_SSIM_RADIUS = 5


@dataclass(frozen=True)
class ImageAgreement:
    """Agreement of a rendering with a photo over the covered pixels.

    `psnr` and `gain_fitted_psnr` in dB (the latter after one least-squares factor per channel), `ssim` in
    [-1, 1], `offset` (du, dv) in pixels by which the rendering lies right of and below the photo,
    `coverage` the covered share of the frame.
    """

    psnr: float
    gain_fitted_psnr: float
    ssim: float
    offset: tuple[float, float]
    coverage: float


def compare_images(rendered: ByteArray, photo: ByteArray, covered: BoolArray) -> ImageAgreement:
    """Measure everything at once; see `ImageAgreement`."""
    return ImageAgreement(
        psnr(rendered, photo, covered),
        psnr(fit_gain(rendered, photo, covered), photo, covered),
        ssim(rendered, photo, covered),
        image_offset(rendered, photo, covered),
        float(np.mean(covered)),
    )


def psnr(rendered: ByteArray, photo: ByteArray, covered: BoolArray) -> float:
    """Peak signal-to-noise ratio in dB over the covered pixels, all channels together; inf when equal."""
    a, b = _checked(rendered, photo, covered)
    difference = a[covered].astype(np.float64) - b[covered]
    error = float(np.mean(difference * difference))
    return float("inf") if error == 0 else float(10 * np.log10(255.0**2 / error))


def fit_gain(rendered: ByteArray, photo: ByteArray, covered: BoolArray) -> ByteArray:
    """`rendered` times the least-squares factor per channel that brings it closest to `photo`."""
    a, b = _checked(rendered, photo, covered)
    x, y = a[covered].astype(np.float64), b[covered].astype(np.float64)
    gain = np.sum(x * y, axis=0) / np.maximum(np.sum(x * x, axis=0), 1.0)
    fitted: ByteArray = np.clip(np.rint(a * gain), 0, 255).astype(np.uint8)
    return fitted


def ssim(rendered: ByteArray, photo: ByteArray, covered: BoolArray) -> float:
    """Mean structural similarity of the grey images over windows that lie wholly in the covered part.

    Gaussian window, sigma 1.5 px, 11 px wide. Source: Wang, Bovik, Sheikh, Simoncelli 2004, eq. 13. Where no
    window fits, all covered pixels count.
    """
    a, b = _checked(rendered, photo, covered)
    x, y = _grey(a), _grey(b)
    mean_x, mean_y = _smooth(x), _smooth(y)
    var_x, var_y = _smooth(x * x) - mean_x**2, _smooth(y * y) - mean_y**2
    cov = _smooth(x * y) - mean_x * mean_y
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    score = (
        (2 * mean_x * mean_y + c1) * (2 * cov + c2) / ((mean_x**2 + mean_y**2 + c1) * (var_x + var_y + c2))
    )
    whole = _inside(covered, _SSIM_RADIUS)
    return float(np.mean(score[whole if whole.any() else covered]))


def image_offset(rendered: ByteArray, photo: ByteArray, covered: BoolArray) -> tuple[float, float]:
    """Shift (du, dv) in pixels of the rendering against the photo, to a few hundredths of a pixel.

    Least squares on the covered pixels: the shift that explains the grey difference by the image gradient,
    one gain and one offset in brightness alongside, iterated; NaN where too little is covered. Source: Lucas
    and Kanade 1981, translation only.
    """
    a, b = _checked(rendered, photo, covered)
    inner = _inside(covered, 10)  # out of reach of the blur and of the largest shift looked for
    if np.count_nonzero(inner) < 100:
        return float("nan"), float("nan")
    blur_a, blur_b = _smooth(_grey(a)), _smooth(_grey(b))
    shift = np.zeros(2)
    for _ in range(10):
        step = _shift_step(_translated(blur_a, shift), blur_b, inner)
        shift += step
        if float(np.linalg.norm(step)) < 1e-3 or float(np.linalg.norm(shift)) > 4:
            break
    return float(shift[0]), float(shift[1])


def _shift_step(moving: Float32Array, fixed: Float32Array, inner: BoolArray) -> FloatArray:
    """One Gauss-Newton step (du, dv) for `moving(x + shift) = gain * fixed(x) + offset`."""
    along_u = cv2.Sobel(moving, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)[inner].astype(np.float64)
    along_v = cv2.Sobel(moving, cv2.CV_32F, 0, 1, ksize=3, scale=0.125)[inner].astype(np.float64)
    design = np.stack([along_u, along_v, -fixed[inner], -np.ones(len(along_u))], axis=1)
    solution = np.linalg.lstsq(design.T @ design, -design.T @ moving[inner].astype(np.float64), rcond=None)[0]
    step: FloatArray = solution[:2]
    return step


def _translated(image: Float32Array, shift: FloatArray) -> Float32Array:
    """The image looked up at x + shift, by cubic splines (OpenCV's warps round shifts to 1/32 px)."""
    moved: Float32Array = ndimage.shift(image, -shift[::-1], order=3, mode="nearest")
    return moved


def _grey(image: ByteArray) -> Float32Array:
    return cv2.cvtColor(image.astype(np.float32), cv2.COLOR_RGB2GRAY).astype(np.float32, copy=False)


def _smooth(image: Float32Array) -> Float32Array:
    size = 2 * _SSIM_RADIUS + 1
    return cv2.GaussianBlur(image, (size, size), _SSIM_SIGMA).astype(np.float32, copy=False)


def _inside(covered: BoolArray, radius: int) -> BoolArray:
    """Pixels whose whole square window of that radius is covered; the frame's edge counts as uncovered."""
    size = 2 * radius + 1
    window = (size, size)
    count = cv2.boxFilter(
        covered.astype(np.float32), -1, window, normalize=False, borderType=cv2.BORDER_CONSTANT
    )
    whole: BoolArray = count > size * size - 0.5
    return whole


def _checked(rendered: ByteArray, photo: ByteArray, covered: BoolArray) -> tuple[ByteArray, ByteArray]:
    if rendered.shape != photo.shape or rendered.shape[:2] != covered.shape:
        raise TextureError(
            f"Rendering {rendered.shape}, photo {photo.shape} and mask {covered.shape} differ in size: "
            "compare pictures of the same camera."
        )
    if not covered.any():
        raise TextureError("The rendering covers no pixel of the photo: there is nothing to compare.")
    return rendered, photo
