"""The pose that regions give, with what else explains them."""

from __future__ import annotations

from dataclasses import dataclass

from ..pose import Pose


@dataclass(frozen=True, eq=False)
class RegionPose(Pose):
    """A pose from regions.

    `overlap_error` is δ in percent, `100 |A xor B| / (|A| + |B|)` between the projected surface regions and
    those of the photo, over all regions; `region_errors` the same per region.
    `ambiguous` says that the regions alone cannot decide: `alternatives` hold poses that explain them as
    well, best first, or the pose is too loosely determined; `reason` says which. `locked` says that the
    outlines coincide to a fraction of a pixel over much of their length.
    """

    overlap_error: float = 0.0
    region_errors: tuple[float, ...] = ()
    alternatives: tuple[RegionPose, ...] = ()
    ambiguous: bool = False
    reason: str = ""
    locked: bool = False
