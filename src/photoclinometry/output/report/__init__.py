"""The report of a run: figures, one page that shows them, and every figure's number as JSON."""

from photoclinometry.output.report.report import write_report

__all__ = ["write_report"]
