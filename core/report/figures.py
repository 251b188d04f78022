"""Pictures of the report: photos with their regions."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np

from ..arrays import ByteArray, FloatArray
from ..cameras import Camera
from ..errors import FrescoError
from ..photos.image import read_image
from ..photos.marks import RegionMark
from ..photos.photo import Photo
from ..pose import Pose
from ..regions.image_region import ImageRegion
from ..regions.surface_region import SurfaceRegion

DRAWN = (240, 160, 0)
PROJECTED = (40, 120, 255)
_SHIFT = 4
_BOUNDARY_STEPS = 8
_JPEG_QUALITY = 82


def draw_photo(
    photo: Photo, pose: Pose | None, surfaces: Mapping[str, SurfaceRegion], width: int = 960
) -> ByteArray:
    """A photo, at most `width` pixels wide, with its regions as drawn and as projected from the scan."""
    factor = min(1.0, width / photo.camera.width)
    image = read_image(photo.path, factor)
    camera = photo.camera.resized(image.shape[1], image.shape[0])
    for mark in photo.regions:
        loops = [_resized(loop, photo.camera, camera) for loop in _drawn_loops(mark, photo.camera)]
        _outline(image, loops, (0, 0, 0), 7, closed=True)
        _outline(image, loops, DRAWN, 5, closed=True)
        if pose is not None and mark.name in surfaces:
            runs = projected_loops(camera, pose, surfaces[mark.name])
            _outline(image, runs, PROJECTED, 2, closed=False)
        if loops:
            _label(image, mark.name, loops[0].mean(axis=0))
    return image


def projected_loops(camera: Camera, pose: Pose, surface: SurfaceRegion) -> list[FloatArray]:
    """Boundary of a surface region in a photo: (n,2) pixels per visible run of its loops."""
    runs = []
    for loop in surface.loops:
        share = np.arange(_BOUNDARY_STEPS)[:, None] / _BOUNDARY_STEPS
        dense = (loop[:, None] * (1 - share) + np.roll(loop, -1, axis=0)[:, None] * share).reshape(-1, 3)
        pixels = camera.project((dense - pose.centre) @ pose.rotation.T)
        pixels = np.concatenate([pixels, pixels[:1]])
        jump = np.linalg.norm(np.diff(pixels, axis=0), axis=1) > 0.25 * camera.width  # the seam of a panorama
        breaks = np.flatnonzero(jump | ~np.isfinite(pixels).all(axis=1)[1:]) + 1
        runs += [run[np.isfinite(run).all(axis=1)] for run in np.split(pixels, breaks)]
    return [run for run in runs if len(run) > 1]


def jpeg(image: ByteArray) -> bytes:
    """JPEG of an RGB picture."""
    coded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1]
    return coded.tobytes()


def _drawn_loops(mark: RegionMark, camera: Camera) -> list[FloatArray]:
    """Outlines of a mark in the photo's own pixels; none when it cannot be read."""
    if mark.outline is not None:
        return [mark.outline, *mark.holes]
    try:
        mask = mark.read_mask(camera.width, camera.height)
    except FrescoError:  # the pose stage has told the reason, which stands beside the picture
        return []
    return [] if mask is None else list(ImageRegion.from_mask(mask, mark.name).loops)


def _resized(loop: FloatArray, full: Camera, small: Camera) -> FloatArray:
    factor = np.array([small.width / full.width, small.height / full.height])
    moved: FloatArray = (loop + 0.5) * factor - 0.5
    return moved


def _outline(
    image: ByteArray, loops: list[FloatArray], colour: tuple[int, int, int], width: int, closed: bool
) -> None:
    """Draw lines in place, each (n,2) pixels."""
    points = [np.rint(np.clip(loop, -1e4, 1e4) * 2**_SHIFT).astype(np.int32) for loop in loops]
    cv2.polylines(image, points, closed, colour, width, cv2.LINE_AA, _SHIFT)


def _label(image: ByteArray, text: str, at: FloatArray) -> None:
    """Write a name centred at a pixel; OpenCV's letters are plain ASCII, the page lists the full names."""
    plain = text.encode("ascii", "replace").decode()
    (width, height), _ = cv2.getTextSize(plain, cv2.FONT_HERSHEY_SIMPLEX, 0.6, 1)
    place = (round(float(at[0]) - width / 2), round(float(at[1]) + height / 2))
    for colour, thickness in (((0, 0, 0), 4), ((255, 255, 255), 1)):
        cv2.putText(image, plain, place, cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, thickness, cv2.LINE_AA)
