"""What the sensors make of the light: patterns, grey values, images, clouds."""

from exposight.twin.sensors.active_stereo import DotSensor
from exposight.twin.sensors.exposure import CameraElectronics, expose
from exposight.twin.sensors.flat_fields import FlatFields, take_flat_fields
from exposight.twin.sensors.settings import (
    SensorSettings,
    electrons_on_matt_white,
    matt_white_radiance,
    sensor_settings,
    sequence_of,
    with_table,
)
from exposight.twin.sensors.structured_light import StripeSensor, ring_boxes
