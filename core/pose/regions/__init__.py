"""Pose from regions."""

from .estimate import estimate_pose, estimate_pose_job
from .region_pose import RegionPose

__all__ = ["RegionPose", "estimate_pose", "estimate_pose_job"]
