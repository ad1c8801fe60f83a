"""Carry out a measuring plan on a driver: captures on disk, or observations at once."""

from exposight.measuring.adaptive import LoopResult, measure_adaptively
from exposight.measuring.capture_table import CaptureTable, read_capture_table
from exposight.measuring.collect import Collected, CollectSettings, collect
from exposight.measuring.decisions import Decision
from exposight.measuring.loop_state import LoopState, LoopStep, loop_step, read_state
from exposight.measuring.measure import (
    check_table_path,
    measure,
    measure_observations,
    views_folder,
)
from exposight.measuring.record import recorded_driver
from exposight.measuring.view_work import OBSERVATIONS_FILE
