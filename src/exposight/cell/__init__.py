"""The words of a measuring cell: features, parts, sensors, clouds, captures, campaigns, files."""

from exposight.cell.campaign import (
    CampaignFolder,
    CampaignWriter,
    CaptureSource,
    MemoryCampaign,
    write_numbered_capture,
)
from exposight.cell.capture import Capture, CaptureKey
from exposight.cell.cloud import Cloud
from exposight.cell.cloud_formats.cloud_files import (
    CLOUD_SUFFIXES,
    LENGTH_UNITS_MM,
    read_cloud,
    write_cloud,
)
from exposight.cell.cloud_formats.depth_images import (
    cloud_from_depth,
    is_depth_image,
    read_depth,
    read_depth_cloud,
)
from exposight.cell.driver import (
    ROUNDED_SHARE,
    Driver,
    closing_driver,
    exposure_share,
    same_exposure,
)
from exposight.cell.feature_lists.feature_files import read_features, write_features
from exposight.cell.image import (
    GREY_MAX,
    BitDepth,
    Image,
    check_levels,
    full_scale,
    png_bytes,
    right_aligned,
)
from exposight.cell.part import PAPER_TOLERANCE, RULES, Feature, FeatureKind, Part, RingTolerance
from exposight.cell.recordings import (
    Recording,
    Recordings,
    exif_exposure_ms,
    find_recordings,
)
from exposight.cell.sensor import (
    PRESETS,
    ActiveSensor,
    ExposureRange,
    Projector,
    StoredPose,
    preset_name,
    read_sensor,
    sensor_named_or_read,
    sensor_preset,
    write_sensor,
)
from exposight.cell.stack_images import EVEN_SOURCES, BrightnessSource, StackImages
