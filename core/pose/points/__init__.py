"""Camera poses from points: markers found in photos, surveyed coordinates, hand-picked pairs."""

from .estimate import PointPose, estimate_pose_from_points, estimate_pose_from_points_job

__all__ = ["PointPose", "estimate_pose_from_points", "estimate_pose_from_points_job"]
