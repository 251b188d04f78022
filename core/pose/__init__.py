"""Camera poses: from regions, from points, by edges, jointly; with their uncertainty."""

from .edges import EdgePose, refine_pose_by_edges, refine_pose_by_edges_job
from .joint import JointPose, LensFit, refine_poses_jointly, refine_poses_jointly_job
from .points import PointPose, estimate_pose_from_points, estimate_pose_from_points_job
from .points.shift import predicted_face_shift, predicted_face_shift_job, predicted_shift
from .pose import Pose
from .regions import (
    CalibratedPose,
    RegionPose,
    estimate_pose,
    estimate_pose_and_focal,
    estimate_pose_job,
)

__all__ = [
    "CalibratedPose",
    "EdgePose",
    "JointPose",
    "LensFit",
    "PointPose",
    "Pose",
    "RegionPose",
    "estimate_pose",
    "estimate_pose_and_focal",
    "estimate_pose_from_points",
    "estimate_pose_from_points_job",
    "estimate_pose_job",
    "predicted_face_shift",
    "predicted_face_shift_job",
    "predicted_shift",
    "refine_pose_by_edges",
    "refine_pose_by_edges_job",
    "refine_poses_jointly",
    "refine_poses_jointly_job",
]
