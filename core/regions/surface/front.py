"""The scan around a click seen from the front: heights and normals over a plane, cell by cell.

Seen along the normal, orthographically, panels, friezes and pilasters are bounded by straight creases and
steps, whatever relief they carry.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...arrays import ArrayLike, BoolArray, Float32Array, FloatArray, IndexArray
from .index import SurfaceIndex
from .robust_fit import SurfaceFit

_DEPTH = 0.6  # of half a view's size, before and behind the plane: what is farther off is another room
_AWAY = -0.05  # cosine to the plane's normal below which a face is seen from behind
_FILLED = 0.3  # share of the cells around a gap that has to be seen


@dataclass(frozen=True, eq=False)
class FrontView:
    """Scan over `plane`, in cells of `cell` m: row 0 is at the plane's largest second coordinate.

    `height` (H,H) m, `normal` (H,H,3) in the plane's axes, `seen` (H,H) where there is any surface, and
    `face` (H,H), the scan's number of the face seen, or -1; `colour` (H,H,3) CIELAB, or None.
    """

    plane: SurfaceFit
    cell: float
    height: Float32Array
    normal: Float32Array
    seen: BoolArray
    face: IndexArray
    colour: Float32Array | None

    @property
    def size(self) -> int:
        """Cells along a side."""
        return len(self.height)

    @property
    def middle(self) -> FloatArray:
        """Pixel (2,) of the plane's centre."""
        return np.full(2, (self.size - 1) / 2)

    def pixels(self, places: ArrayLike) -> FloatArray:
        """Pixels (...,2) of places (...,2) m on the plane."""
        flipped = np.asarray(places, dtype=np.float64) * (1.0, -1.0)
        pixels: FloatArray = flipped / self.cell + self.middle
        return pixels

    def places(self, pixels: ArrayLike) -> FloatArray:
        """Places (...,2) m on the plane of pixels (...,2)."""
        off = (np.asarray(pixels, dtype=np.float64) - self.middle) * self.cell
        places: FloatArray = off * (1.0, -1.0)
        return places


def front_view(
    index: SurfaceIndex, plane: SurfaceFit, cell: float, size: int, coloured: bool = True
) -> FrontView:
    """View of `size` x `size` cells of `cell` m around the centre of a plane, `coloured` if the scan is."""
    off = (np.arange(size) - (size - 1) / 2) * cell
    across, up = np.meshgrid(off, -off)
    depth = _DEPTH * cell * size / 2
    start = plane.centre + depth * plane.normal
    origin = start + across.reshape(-1, 1) * plane.axes[0] + up.reshape(-1, 1) * plane.axes[1]
    hit = index.caster.first_hit(origin, np.broadcast_to(-plane.normal, origin.shape))
    face = hit.face.astype(np.int64)
    normal = index.smooth_normal[face] @ plane.axes.T.astype(np.float32)
    seen = (face >= 0) & (hit.distance < 2 * depth) & (normal[:, 2] > _AWAY)
    picture = [normal, (depth - hit.distance)[:, None]]
    if coloured and index.colour is not None:
        picture.append(index.colour[face])
    channels = np.concatenate(picture, axis=1, dtype=np.float32)
    channels[~seen], face[~seen] = 0, -1
    seen, channels = _filled(seen.reshape(size, size), channels.reshape(size, size, -1))
    normal, height = np.ascontiguousarray(channels[..., :3]), np.ascontiguousarray(channels[..., 3])
    colour = np.ascontiguousarray(channels[..., 4:]) if len(picture) > 2 else None
    return FrontView(plane, cell, height, normal, seen, face.reshape(size, size), colour)


def _filled(seen: BoolArray, channels: Float32Array) -> tuple[BoolArray, Float32Array]:
    """Where something is seen (H,H), and what (H,H,k): gaps of few cells take what is around them."""
    known = seen.astype(np.float32)
    for _ in range(2):
        share = cv2.blur(known, (3, 3))
        gap = (known == 0) & (share > _FILLED)
        around = np.dstack([cv2.blur(channels[..., k], (3, 3))[gap] for k in range(channels.shape[2])])[0]
        channels[gap] = around / share[gap][:, None]
        known[gap] = 1
    return known > 0, channels
