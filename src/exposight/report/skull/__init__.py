"""The report of the demonstration on the recorded skull: its page."""

from exposight.report.skull.page import skull_report
