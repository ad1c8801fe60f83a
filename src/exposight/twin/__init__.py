"""A measuring cell made of physics: a part, light, sensors that saturate; a driver like others."""

from exposight.twin.cell_settings import (
    Alignment,
    AlignmentErrors,
    SimulatedCellSettings,
    draw_alignment,
)
from exposight.twin.light import LightModel, SceneTracer
from exposight.twin.part import FINISHES, Scene, export_scene, read_scene
from exposight.twin.sensors import CameraElectronics, DotSensor, StripeSensor
from exposight.twin.simulated_cell import SimulatedCell, scene_at, scene_checksum
