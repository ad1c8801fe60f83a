"""Results to one HTML page that opens without a network."""

from exposight.report.door_page import door_report
from exposight.report.page import write_report
from exposight.report.skull_page import skull_report

__all__ = ["door_report", "skull_report", "write_report"]
