"""What reaches a camera's pixels: rays, the projector, its reflections, the lenses."""

from exposight.twin.light.optics import (
    AMBIENT_SHARE,
    CameraLens,
    Lighting,
    ProjectorLens,
)
from exposight.twin.light.tracing import MISS_MM, SceneTracer
from exposight.twin.light.view_light import LightModel, TileLight, ViewLight, trace_view
