"""A report of runs: one HTML page that needs no network."""

from steersman.report.html import write_report
from steersman.report.runs import ReportRun, Table, load_runs

__all__ = ["ReportRun", "Table", "load_runs", "write_report"]
