"""What reaches a camera's pixels: rays, the projector, its reflections, the lenses."""

from exposight.twin.light.optics import (
    CameraLens,
    Lighting,
    ProjectorLens,
    SceneTracer,
    ambient_share,
    projector_of,
)
from exposight.twin.light.shading import lamp_of
from exposight.twin.light.view_light import LightModel, TileLight, ViewLight, trace_view
