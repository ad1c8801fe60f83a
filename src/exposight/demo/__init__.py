"""The main job end to end, on a recording that anyone can have."""

from exposight.demo.recording import (
    DATA_VARIABLE,
    NOMINAL_EXPOSURE_MS,
    SkullRecording,
    decode_to_cloud,
    find_skull,
    read_skull,
    skull_sensor,
)
from exposight.demo.result import DemoResult, DemoSettings, ModelResult, SequenceCheck
from exposight.demo.study import run_demo
from exposight.demo.surface_features import PlacementRules, place_features

__all__ = [
    "DATA_VARIABLE",
    "NOMINAL_EXPOSURE_MS",
    "DemoResult",
    "DemoSettings",
    "ModelResult",
    "PlacementRules",
    "SequenceCheck",
    "SkullRecording",
    "decode_to_cloud",
    "find_skull",
    "place_features",
    "read_skull",
    "run_demo",
    "skull_sensor",
]
