"""A measuring cell made of physics: a part, light, sensors that saturate."""

from exposight.twin.active_stereo import DotSensor
from exposight.twin.alignment import AlignmentErrors
from exposight.twin.exposure import CameraElectronics
from exposight.twin.light import LightModel
from exposight.twin.plan import DepthPlane, MeasuringPlan, RandomPositions
from exposight.twin.plan_file import read_plan, write_plan
from exposight.twin.plan_presets import PLANS, plan_preset
from exposight.twin.planned_views import PlannedView, views
from exposight.twin.scene import Scene
from exposight.twin.scene_files import export_scene, read_scene
from exposight.twin.simulated_cell import (
    CellSettings,
    scene_at,
    simulate,
    simulate_observations,
)
from exposight.twin.structured_light import StripeSensor
from exposight.twin.surfaces import FINISHES
from exposight.twin.tracing import SceneTracer

__all__ = [
    "FINISHES",
    "PLANS",
    "AlignmentErrors",
    "CameraElectronics",
    "CellSettings",
    "DepthPlane",
    "DotSensor",
    "LightModel",
    "MeasuringPlan",
    "PlannedView",
    "RandomPositions",
    "Scene",
    "SceneTracer",
    "StripeSensor",
    "export_scene",
    "plan_preset",
    "read_plan",
    "read_scene",
    "scene_at",
    "simulate",
    "simulate_observations",
    "views",
    "write_plan",
]
