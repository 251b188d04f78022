"""Refinement of all poses together: features matched between photos, met on the scan."""

from .lens import LensFit
from .refine import JointPose, refine_poses_jointly, refine_poses_jointly_job

__all__ = ["JointPose", "LensFit", "refine_poses_jointly", "refine_poses_jointly_job"]
