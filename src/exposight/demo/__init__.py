"""The main job end to end: on the simulated cell, and on a recording that anyone can have."""

from exposight.demo.door import (
    EXPOSURE_MODEL,
    QUALITY_MODEL,
    DoorResult,
    DoorSettings,
    NewView,
    run_door,
)
from exposight.demo.door_picture import DoorMesh
from exposight.demo.recording import (
    DATA_VARIABLE,
    NOMINAL_EXPOSURE_MS,
    SkullRecording,
    decode_to_cloud,
    find_skull,
    read_skull,
    skull_sensor,
)
from exposight.demo.result import DemoResult, DemoSettings, ModelResult
from exposight.demo.skull import SequenceCheck, SkullResult, SkullSettings, run_skull
from exposight.demo.surface_features import PlacementRules, place_features
