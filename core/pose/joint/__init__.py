"""Refinement of all poses together: features matched between photos, met on the scan."""

from .lens import LensFit
from .refine import JointPose, refine_poses_jointly, refine_poses_jointly_job
from .residuals import TieResiduals

__all__ = ["JointPose", "LensFit", "TieResiduals", "refine_poses_jointly", "refine_poses_jointly_job"]
