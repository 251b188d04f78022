"""Camera poses: from regions, from points, by edges, jointly; with their uncertainty."""

from .pose import Pose
from .regions import RegionPose, estimate_pose, estimate_pose_job

__all__ = ["Pose", "RegionPose", "estimate_pose", "estimate_pose_job"]
