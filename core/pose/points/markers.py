"""Markers in photos, to sub-pixel: coded squares (ArUco, AprilTag), round and checkerboard targets."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import AnyArray, ArrayLike, ByteArray, Float32Array, FloatArray
from ...errors import PhotoError

FAMILIES = {
    "apriltag-36h11": cv2.aruco.DICT_APRILTAG_36h11,
    "apriltag-25h9": cv2.aruco.DICT_APRILTAG_25h9,
    "apriltag-16h5": cv2.aruco.DICT_APRILTAG_16h5,
    "aruco-4x4": cv2.aruco.DICT_4X4_1000,
    "aruco-5x5": cv2.aruco.DICT_5X5_1000,
    "aruco-6x6": cv2.aruco.DICT_6X6_1000,
    "aruco-original": cv2.aruco.DICT_ARUCO_ORIGINAL,
}
"""Families of coded squares by the name a user chooses."""


@dataclass(frozen=True, eq=False)
class Marker:
    """A marker in a photo: `name` is its code, empty for uncoded ones; `pixel` (2,) its centre.

    The centre of the top-left pixel is (0, 0).
    """

    name: str
    pixel: FloatArray


def detect_coded_markers(photo: ByteArray, family: str = "apriltag-36h11") -> list[Marker]:
    """Centres of the coded squares of a family in a photo (H,W,3) RGB or (H,W).

    The centre is where the diagonals cross, which perspective does not move. Raises `PhotoError` for an
    unknown family. Source: Garrido-Jurado et al. 2014; Olson 2011 for AprilTag.
    """
    if family not in FAMILIES:
        raise PhotoError(f"There is no marker family “{family}”: choose one of {', '.join(FAMILIES)}.")
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(FAMILIES[family])
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(_grey(photo))
    return [
        Marker(str(int(code)), _diagonals_cross(square.reshape(4, 2).astype(np.float64)))
        for code, square in zip([] if len(corners) == 0 else np.ravel(ids), corners, strict=True)
    ]


def _diagonals_cross(square: FloatArray) -> FloatArray:
    homogeneous = np.column_stack([square, np.ones(4)])
    first = np.cross(homogeneous[0], homogeneous[2])
    second = np.cross(homogeneous[1], homogeneous[3])
    crossing = np.cross(first, second)
    out: FloatArray = crossing[:2] / crossing[2]
    return out


def detect_round_markers(photo: ByteArray, smallest: float = 8.0, largest: float = 400.0) -> list[Marker]:
    """Centres of round targets of one brightness on another: (H,W,3) RGB or (H,W); diameters in pixels.

    The ellipse is fitted to the gradients along its rim, not to thresholded pixels. Source: Ouellet and
    Hébert 2009, "Precise ellipse estimation without contour point extraction" (dual conic).
    """
    grey = _grey(photo)
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.0)
    block = int(max(15, 2 * (min(grey.shape) // 40) + 1))
    found: list[Marker] = []
    for kind in (cv2.THRESH_BINARY, cv2.THRESH_BINARY_INV):
        binary = cv2.adaptiveThreshold(smooth, 255, cv2.ADAPTIVE_THRESH_MEAN_C, kind, block, -8)
        if kind == cv2.THRESH_BINARY_INV:
            binary = cv2.adaptiveThreshold(smooth, 255, cv2.ADAPTIVE_THRESH_MEAN_C, kind, block, 8)
        contours, _ = cv2.findContours(binary, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        for contour in contours:
            centre = _round_centre(grey, contour, smallest, largest)
            if centre is not None and all(np.linalg.norm(centre - m.pixel) > 3 for m in found):
                found.append(Marker("", centre))
    return found


def _round_centre(grey: ByteArray, contour: AnyArray, smallest: float, largest: float) -> FloatArray | None:
    """Centre of an elliptic contour, None for any other shape."""
    points = contour.reshape(-1, 2)
    if len(points) < 12:
        return None
    (u, v), axes, angle = cv2.fitEllipse(points)
    short, long = sorted(axes)
    if not (smallest <= short and long <= largest and short > 0.25 * long):
        return None
    area = cv2.contourArea(points)
    if abs(area / (np.pi / 4 * short * long) - 1) > 0.12:
        return None
    centred = points - np.array([u, v])
    cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    along, across = centred @ [cosine, sine], centred @ [-sine, cosine]
    radius = np.hypot(along / (axes[0] / 2), across / (axes[1] / 2))
    if np.abs(radius - 1).max() > 0.2 + 2.0 / short:
        return None
    return _dual_conic_centre(grey, np.array([u, v]), (axes[0] / 2, axes[1] / 2), angle)


def _dual_conic_centre(
    grey: ByteArray, start: FloatArray, radii: tuple[float, float], angle: float
) -> FloatArray | None:
    """Centre of the ellipse that is tangent to the edge lines around a first guess."""
    reach = int(np.ceil(max(radii) * 1.35 + 3))
    left, top = np.round(start).astype(int) - reach
    if left < 0 or top < 0 or left + 2 * reach >= grey.shape[1] or top + 2 * reach >= grey.shape[0]:
        return None
    patch = grey[top : top + 2 * reach + 1, left : left + 2 * reach + 1].astype(np.float32)
    gx = cv2.Sobel(patch, cv2.CV_32F, 1, 0, ksize=3)
    gy = cv2.Sobel(patch, cv2.CV_32F, 0, 1, ksize=3)
    v, u = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(np.float64)
    cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    offset = start - np.round(start)
    du, dv = u - offset[0], v - offset[1]
    along, across = du * cosine + dv * sine, -du * sine + dv * cosine
    ring = np.hypot(along / radii[0], across / radii[1])
    use = (np.abs(ring - 1) < max(0.3, 2.5 / min(radii))) & (gx**2 + gy**2 > 0)
    # the edge line through a pixel: normal (gx, gy), weighted by the squared gradient through its length
    scale = 1.0 / reach
    a, b = gx[use].astype(np.float64), gy[use].astype(np.float64)
    c = -(a * u[use] + b * v[use]) * scale
    rows = np.column_stack([a * a, a * b, b * b, a * c, b * c])
    # l^T C l = 0 with the dual conic's last entry 1: then its last column is the centre
    solution = np.linalg.lstsq(rows, -c * c, rcond=None)[0]
    centre = np.round(start) + 0.5 * solution[3:5] / scale
    return centre if np.linalg.norm(centre - start) < 2.0 + 0.1 * max(radii) else None


def detect_checkerboard_markers(photo: ByteArray, contrast: float = 40.0, radius: int = 6) -> list[Marker]:
    """Centres of two-by-two checkerboard targets: where four alternating quadrants meet.

    photo (H,W,3) RGB or (H,W); `contrast`: least difference of the quadrants; `radius` (px) of the ring that
    is looked at. Source: ChESS corner response, Bennett and Lasenby 2014.
    """
    grey = _grey(photo).astype(np.float32)
    response = _chess_response(cv2.GaussianBlur(grey, (0, 0), 1.0).astype(np.float32), radius)
    peak = cv2.dilate(response, np.ones((2 * radius + 1, 2 * radius + 1), np.uint8))
    rows, columns = np.nonzero((response == peak) & (response > 4 * contrast))
    markers = []
    for u, v in zip(columns, rows, strict=True):
        corner = snap_to_corner(photo, (float(u), float(v)), radius)
        if corner is not None:
            markers.append(Marker("", corner))
    return markers


def _chess_response(grey: Float32Array, radius: int) -> Float32Array:
    """ChESS response (H,W): opposite samples on a ring agree, those a quarter turn apart differ."""
    angles = np.arange(16) * np.pi / 8
    offsets = np.round(radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)).astype(int)
    padded = cv2.copyMakeBorder(grey, radius, radius, radius, radius, cv2.BORDER_REPLICATE)
    height, width = grey.shape
    ring = [
        padded[radius + dv : radius + dv + height, radius + du : radius + du + width] for du, dv in offsets
    ]
    alternating = sum(np.abs(ring[k] + ring[k + 8] - ring[k + 4] - ring[(k + 12) % 16]) for k in range(4))
    edge = sum(np.abs(ring[k] - ring[k + 8]) for k in range(8))
    local = cv2.blur(grey, (5, 5))
    mean = np.abs(sum(ring) / np.float32(16) - local) * 16
    out: Float32Array = np.asarray(alternating - edge - mean, dtype=np.float32)
    return out


def snap_to_corner(photo: ByteArray, pixel: ArrayLike, radius: int = 6) -> FloatArray | None:
    """The corner nearest to a picked pixel, to sub-pixel: (2,) or None where there is none within `radius`.

    Source: Förstner and Gülch 1987, as in OpenCV's cornerSubPix: gradients point past the corner.
    """
    grey = _grey(photo)
    start = np.asarray(pixel, dtype=np.float64)
    border = radius + 2
    inside = (start >= border) & (start <= np.array(grey.shape[::-1]) - 1 - border)
    if not inside.all():
        return None
    points = start.astype(np.float32).reshape(1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 0.001)
    refined = (
        cv2.cornerSubPix(grey, points, (radius, radius), (-1, -1), criteria).reshape(2).astype(np.float64)
    )
    return refined if np.linalg.norm(refined - start) < radius else None


def _grey(photo: ByteArray) -> ByteArray:
    grey = cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY) if photo.ndim == 3 else photo
    return np.ascontiguousarray(grey, dtype=np.uint8)
