"""Carry out a measuring plan on a driver: captures on disk, or observations at once."""

from exposight.measuring.kept_views import check_table_path, views_folder
from exposight.measuring.measure import measure, measure_observations
from exposight.measuring.record import recorded_driver
from exposight.measuring.view_work import OBSERVATIONS_FILE
