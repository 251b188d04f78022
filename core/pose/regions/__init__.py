"""Pose from regions."""

from .estimate import estimate_pose, estimate_pose_job
from .focal import CalibratedPose, estimate_pose_and_focal
from .region_pose import RegionPose

__all__ = ["CalibratedPose", "RegionPose", "estimate_pose", "estimate_pose_and_focal", "estimate_pose_job"]
