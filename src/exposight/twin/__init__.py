"""A measuring cell made of physics: a part, light, sensors that saturate."""

from exposight.plans import (
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
from exposight.twin.campaign import CellSettings, scene_at, simulate, simulate_observations
from exposight.twin.light import LightModel, SceneTracer
from exposight.twin.part import FINISHES, Scene, export_scene, read_scene
from exposight.twin.sensors import CameraElectronics, DotSensor, StripeSensor
