"""The result of choosing photos: for every face the photo, the pixels, and what the maps show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import AnyArray, BoolArray, Float32Array, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Selection:
    """Photo of every face, in the caller's order of faces; V photos, F faces. All fields are arrays.

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
    blur
        (F,) blur (sigma, pixels) of the chosen photo at the face's distance; NaN where unknown.
    photo_name
        (V,) names for messages.
    left_out
        (V,) photos that were not used because their pose or contents contradict the others.
    pose_shift
        (V,) median distance (pixels) between where a photo's pose puts details and where its neighbours do;
        NaN where nothing could be compared.
    pose_matched
        (V,) share of the photo's details found again in its neighbours; NaN likewise.
    foreign_share
        (V,) share of a photo's faces on which it shows something that other photos do not.
    """

    view: IntArray
    uv: FloatArray
    gain: FloatArray
    runner_up: IntArray
    view_count: IntArray
    texel_size: Float32Array
    angle: Float32Array
    blur: Float32Array
    photo_name: AnyArray
    left_out: BoolArray
    pose_shift: FloatArray
    pose_matched: FloatArray
    foreign_share: FloatArray

    @property
    def predicted_shift(self) -> Float32Array:
        """Pixels by which each face's photo disagrees with its neighbours: (F,), NaN where unknown."""
        shift = np.append(self.pose_shift, np.nan).astype(np.float32)
        of_face: Float32Array = shift[self.view]  # -1 takes the last, NaN
        return of_face

    @property
    def warnings(self) -> list[str]:
        """Sentences for the user about photos that were left out."""
        return [self._warning(int(number)) for number in np.flatnonzero(self.left_out)]

    def _warning(self, number: int) -> str:
        name, shift = self.photo_name[number], self.pose_shift[number]
        if np.isfinite(shift) and self.pose_matched[number] > 0.3:
            return (
                f"{name}: its pose disagrees with the other photos by about {shift:.0f} pixels; "
                "it was left out. Solve or refine its pose again."
            )
        return (
            f"{name}: what it shows is not found in the other photos; it was left out. "
            "Check its pose and its camera."
        )
