"""The report of the paper's study: its page, its figures as stills, its tables as CSV."""

from exposight.report.study.files import StudyFiles, write_study
from exposight.report.study.page import study_report
