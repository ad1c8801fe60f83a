"""What reaches a camera's pixels: rays, the projector, its reflections, the lenses."""

from exposight.twin.light.optics import (
    AMBIENT_SHARE,
    MISS_MM,
    CameraLens,
    Lighting,
    ProjectorLens,
    SceneTracer,
    projector_of,
)
from exposight.twin.light.view_light import LightModel, TileLight, ViewLight, trace_view
