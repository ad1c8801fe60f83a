"""Results to one HTML page that opens without a network."""

from exposight.report.page import demo_report, write_demo_report

__all__ = ["demo_report", "write_demo_report"]
