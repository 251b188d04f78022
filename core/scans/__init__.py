"""Scans: reading, checking, aligning."""

from .read import READERS, read_scan, read_scan_job
from .scan import Scan

__all__ = ["READERS", "Scan", "read_scan", "read_scan_job"]
