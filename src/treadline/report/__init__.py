"""Figures, tables and pages, drawn from run folders alone."""

from treadline.report.run_page import write_report

__all__ = ["write_report"]
