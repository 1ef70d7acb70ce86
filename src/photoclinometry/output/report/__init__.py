"""The report of a run: figures, one page that shows them, and every figure's number as JSON."""

from photoclinometry.output.report.report import ReportContent, write_report

__all__ = ["ReportContent", "write_report"]
