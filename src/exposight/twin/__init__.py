"""A measuring cell made of physics: a part, light, sensors that saturate; a driver like others."""

from exposight.twin.cell_settings import AlignmentErrors, SimulatedCellSettings, draw_alignment
from exposight.twin.gige_vision import ServedCell
from exposight.twin.part import Scene, export_scene
from exposight.twin.served_rc_visard import ServedRcVisard
from exposight.twin.simulated_cell import SimulatedCell, scene_at, scene_checksum
