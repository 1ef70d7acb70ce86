"""The report of a run: figures, one page that shows them, and every figure's number as JSON."""

from photoclinometry.report.report import write_report

__all__ = ["write_report"]
