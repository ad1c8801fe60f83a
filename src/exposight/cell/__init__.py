"""The words of a measuring cell: features, parts, sensors, clouds, captures, campaigns, files."""

from exposight.cell.archive import CampaignFolder, CampaignWriter, write_numbered_capture
from exposight.cell.campaign import CaptureSource, MemoryCampaign
from exposight.cell.capture import Capture, CaptureKey, check_image
from exposight.cell.cloud import Cloud, check_points
from exposight.cell.cloud_files import CLOUD_SUFFIXES, LENGTH_UNITS_MM, read_cloud, write_cloud
from exposight.cell.driver import Driver
from exposight.cell.feature_files import read_features, write_features
from exposight.cell.kinds import PAPER_TOLERANCE, RULES, FeatureKind, RingTolerance
from exposight.cell.part import Feature, Part
from exposight.cell.presets import PRESETS, PresetName, sensor_named_or_read, sensor_preset
from exposight.cell.sensor import ActiveSensor, Projector, read_sensor, write_sensor
