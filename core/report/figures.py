"""Pictures of the report: photos with their regions, the model from two sides, maps."""

from __future__ import annotations

import colorsys
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from ..arrays import BoolArray, ByteArray, FloatArray
from ..cameras import Camera
from ..errors import FrescoError
from ..photos.image import read_image
from ..photos.marks import RegionMark
from ..photos.photo import Photo
from ..pose import Pose
from ..project.textures import TexturedScan
from ..regions.image_region import ImageRegion
from ..regions.surface_region import SurfaceRegion

DRAWN = (240, 160, 0)
PROJECTED = (40, 120, 255)
_UNSEEN = (120, 120, 124)
_SHIFT = 4
_BOUNDARY_STEPS = 8
_JPEG_QUALITY = 82


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


def photo_map(textured: TexturedScan, names: list[str]) -> FaceMap:
    """Which photo every face uses."""
    palette = np.array([*(photo_colour(number) for number in range(len(names))), _UNSEEN], dtype=np.uint8)
    view = textured.selection.view
    shown = np.unique(view[view >= 0])
    entries = [(photo_colour(int(number)), names[number]) for number in shown[:40]]
    return FaceMap("Photo used", palette[view], (*entries, (_UNSEEN, "no photo")))


def texel_map(textured: TexturedScan) -> FaceMap:
    """Size of a photo's pixel on the surface, on a logarithmic scale from its 2nd to its 98th percentile."""
    size = 1000 * textured.selection.texel_size.astype(np.float64)
    known = (textured.selection.view >= 0) & np.isfinite(size) & (size > 0)
    low, high = np.percentile(size[known], [2, 98]) if known.any() else (1.0, 1.0)
    share = np.log(np.where(known, size, low) / low) / np.log(max(high / low, 1.001))
    ends = (f"{low:.2g} mm", f"{high:.2g} mm (logarithmic)")
    return _scale_map("Size of a photo pixel on the surface", share, known, ends)


def shift_map(textured: TexturedScan) -> FaceMap | None:
    """How far every face's photo disagrees with its neighbours; None where nothing could be compared."""
    shift = textured.selection.predicted_shift.astype(np.float64)
    known = np.isfinite(shift)
    if not known.any():
        return None
    high = max(1.0, float(shift[known].max()))
    share = np.where(known, shift, 0) / high
    return _scale_map("Shift of the photo against the other photos", share, known, ("0 px", f"{high:.1f} px"))


def _scale_map(title: str, share: FloatArray, known: BoolArray, ends: tuple[str, str]) -> FaceMap:
    """Colours for values (F,) in 0..1 where they are known."""
    scale = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_VIRIDIS)[:, 0, ::-1]
    colours = scale[np.rint(255 * np.clip(share, 0, 1)).astype(np.uint8)].astype(np.uint8)
    colours[~known] = _UNSEEN
    return FaceMap(title, colours, ((_UNSEEN, "not known"),), scale.astype(np.uint8), ends)


def photo_colour(number: int) -> tuple[int, int, int]:
    """Colour of a photo in maps; neighbours in the list differ in hue by the golden angle."""
    lightness = (0.55, 0.42, 0.68)[number % 3]
    r, g, b = colorsys.hls_to_rgb((0.07 + 0.381966 * number) % 1.0, lightness, 0.62)
    return round(255 * r), round(255 * g), round(255 * b)


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
