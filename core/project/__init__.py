"""The project file, the stages of a run, provenance and resuming."""

from .entries import Project
from .load import load_project
from .poses import PhotoPose, solve_poses, solve_poses_job
from .remarks import remarks
from .run import ProjectResult, run_project, run_project_job
from .textures import TexturedScan, texture_scan, texture_scan_job

__all__ = [
    "PhotoPose",
    "Project",
    "ProjectResult",
    "TexturedScan",
    "load_project",
    "remarks",
    "run_project",
    "run_project_job",
    "solve_poses",
    "solve_poses_job",
    "texture_scan",
    "texture_scan_job",
]
