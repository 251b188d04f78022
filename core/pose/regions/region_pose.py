"""The pose that regions give, with what else explains them."""

from __future__ import annotations

from dataclasses import dataclass

from ..pose import Pose


@dataclass(frozen=True, eq=False)
class RegionPose(Pose):
    """A pose from regions.

    `overlap_error` is δ in percent, `100 |A xor B| / (|A| + |B|)` between the projected surface regions and
    those of the photo, over all regions that are whole; `region_errors` the same for each of the photo's,
    NaN for one that is cut off, partly hidden or left out, and for regions that were not paired.
    `ambiguous` says that the regions alone cannot decide: `alternatives` hold poses that explain them as
    well, best first, or the pose is too loosely determined; `reason` says which. `locked` says that the
    outlines coincide over much of their length. `remarks` are sentences on regions that do not fit.
    """

    overlap_error: float = 0.0
    region_errors: tuple[float, ...] = ()
    alternatives: tuple[RegionPose, ...] = ()
    ambiguous: bool = False
    reason: str = ""
    locked: bool = False
    remarks: tuple[str, ...] = ()
