"""The quality report: figures and one page that says what was found, how sure it is, and what failed."""

from .content import Report, project_report
from .write import write_report, write_report_job

__all__ = ["Report", "project_report", "write_report", "write_report_job"]
