"""Scans: reading, checking, aligning."""

from .align import Alignment, align_by_points
from .icp import align_by_surface, align_by_surface_job
from .read import READERS, read_scan, read_scan_job
from .scan import Scan

__all__ = [
    "READERS",
    "Alignment",
    "Scan",
    "align_by_points",
    "align_by_surface",
    "align_by_surface_job",
    "read_scan",
    "read_scan_job",
]
