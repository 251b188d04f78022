"""The project file, the stages of a run, provenance and resuming."""

from .entries import Project
from .file.load import load_project
from .remarks import remarks
from .run import ProjectResult, run_project, run_project_job
from .stages.photo_pose import PhotoPose, Refinement
from .stages.poses import solve_poses, solve_poses_job
from .stages.refinement import RefineSettings, refine_poses, refine_poses_job
from .stages.textures import TexturedScan, texture_scan, texture_scan_job

__all__ = [
    "PhotoPose",
    "Project",
    "ProjectResult",
    "RefineSettings",
    "Refinement",
    "TexturedScan",
    "load_project",
    "refine_poses",
    "refine_poses_job",
    "remarks",
    "run_project",
    "run_project_job",
    "solve_poses",
    "solve_poses_job",
    "texture_scan",
    "texture_scan_job",
]
