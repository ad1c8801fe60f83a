"""The report of the demonstration on the simulated cell's door: its page."""

from exposight.report.door.page import door_report
