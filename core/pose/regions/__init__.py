"""Pose from regions: where a camera stood, from patches seen both in its photo and on the scan.

The stages, in the order of their modules:

* `problem`: regions are checked, moved near the origin and given one flat chart each
  (`geometry.charts`), so that every central camera shares the plane's mathematics.
* `initial`, `algebraic`, `search`: moments up to order 4 of the photo's outline against those of the
  projected boundary (`moment_pair`), whitened by what boundary noise does to them; starts need no
  hints; Levenberg-Marquardt runs from all of them at once.
* `contour`, `consensus`, `fitting`: moments average over drawing errors, so a search around each
  solution looks for the pose at which most of the boundary lies exactly on the outline, first to a
  fraction of a pixel, then, for hand-drawn outlines and jagged scans, within a few. Where it locks,
  robust Gauss-Newton finishes.
* `pixels`: where masks are exact, the boundary is fitted between pixels inside and outside.
* `covariance`, `overlap`, `ambiguity`: how sure the pose is, how well it overlaps, and what else fits
  as well.
* `misfits`: a region that does not fit the others is found and left out.
* `focal`: the same with an unknown focal length.
"""

from .estimate import estimate_pose, estimate_pose_job
from .focal import CalibratedPose, estimate_pose_and_focal
from .region_pose import RegionPose

__all__ = ["CalibratedPose", "RegionPose", "estimate_pose", "estimate_pose_and_focal", "estimate_pose_job"]
