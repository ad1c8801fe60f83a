"""What the sensors make of the light: patterns, grey values, images, clouds."""

from exposight.twin.sensors.active_stereo import DOT_ELECTRONICS, DOT_LIGHT, DotLight, DotSensor
from exposight.twin.sensors.dots import DotPattern
from exposight.twin.sensors.exposure import CameraElectronics, expose
from exposight.twin.sensors.stripes import StripeLight
from exposight.twin.sensors.structured_light import LIMITS, STRIPES, StripeSensor, ring_boxes
