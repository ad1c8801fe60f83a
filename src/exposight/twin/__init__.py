"""A measuring cell made of physics: a part, light, sensors that saturate."""

from exposight.twin.campaign import CellSettings, scene_at, simulate, simulate_observations
from exposight.twin.light import LightModel, SceneTracer
from exposight.twin.part import FINISHES, Scene, export_scene, read_scene
from exposight.twin.plans import (
    PLANS,
    AlignmentErrors,
    DepthPlane,
    MeasuringPlan,
    PlannedView,
    RandomPositions,
    plan_preset,
    read_plan,
    views,
    write_plan,
)
from exposight.twin.sensors import CameraElectronics, DotSensor, StripeSensor

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
