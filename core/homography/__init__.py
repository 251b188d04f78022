"""Homographies between central cameras from regions of planes: relative poses, planes, many views at once.

Everywhere `ray2 ~ matrix @ ray1` with `matrix = R + t nᵀ / d`, the second camera at `X2 = R X1 + t` and the
plane `n . X1 = d`, d > 0, in the frame of the first.
"""

from .estimate import Homography, estimate_homography
from .plane import plane_from_homography
from .planes import PosesAndPlanes, estimate_poses_and_planes, estimate_poses_and_planes_job
from .relative import RelativePose, relative_pose_of_upright_plane, relative_poses_from_homography

__all__ = [
    "Homography",
    "PosesAndPlanes",
    "RelativePose",
    "estimate_homography",
    "estimate_poses_and_planes",
    "estimate_poses_and_planes_job",
    "plane_from_homography",
    "relative_pose_of_upright_plane",
    "relative_poses_from_homography",
]
