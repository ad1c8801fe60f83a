"""What the sensors make of the light: patterns, grey values, images, clouds."""

from exposight.twin.sensors.active_stereo import DOT_ELECTRONICS, DOT_LIGHT, MATCHED_MM, DotSensor
from exposight.twin.sensors.exposure import CameraElectronics, expose
from exposight.twin.sensors.patterns import fringe_sequence
from exposight.twin.sensors.structured_light import LIMITS, StripeSensor, ring_boxes
