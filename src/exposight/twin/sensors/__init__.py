"""What the sensors make of the light: patterns, grey values, images, clouds."""

from exposight.twin.sensors.active_stereo import (
    DOT_ELECTRONICS,
    DOT_LIGHT,
    MATCHED_MM,
    DotLight,
    DotSensor,
)
from exposight.twin.sensors.exposure import CameraElectronics, expose
from exposight.twin.sensors.patterns import (
    DotPattern,
    default_sequence,
    fringe_sequence,
    image_frame,
    projector_of,
)
from exposight.twin.sensors.raw_frames import meaning_of_frames
from exposight.twin.sensors.stripes import StripeLight
from exposight.twin.sensors.structured_light import LIMITS, StripeSensor, ring_boxes
