"""The result of choosing photos: for every face the photo, the pixels, and what the maps show."""

from __future__ import annotations

from dataclasses import dataclass

from ..arrays import Float32Array, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Selection:
    """Photo of every face, in the caller's order of faces; V photos, F faces.

    Attributes
    ----------
    view
        (F,) photo number, -1 where no photo sees the face.
    uv
        (F,3,2) pixels of the corners in that photo, (0, 0) the centre of its top-left pixel; 0 where unseen.
    gain
        (V,3) linear RGB factors of the photos: `to_linear(pixel) * gain[view]` agrees between photos.
    runner_up
        (F,) the photo that would take its place, -1 where there is none.
    view_count
        (F,) number of photos that see the face.
    texel_size
        (F,) side of a square pixel laid on the surface, m; NaN where unseen.
    angle
        (F,) degrees between viewing ray and face normal; NaN where unseen.
    """

    view: IntArray
    uv: FloatArray
    gain: FloatArray
    runner_up: IntArray
    view_count: IntArray
    texel_size: Float32Array
    angle: Float32Array
