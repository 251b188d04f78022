"""Refinement of one pose by edges of the scan: silhouettes, depth steps, creases, colour."""

from .refine import EdgePose, refine_pose_by_edges, refine_pose_by_edges_job, refine_pose_on_scan_job

__all__ = ["EdgePose", "refine_pose_by_edges", "refine_pose_by_edges_job", "refine_pose_on_scan_job"]
