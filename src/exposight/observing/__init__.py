"""Captures to rows: p_norm, i_avg and pose of every feature (Sect. 3.1 of the paper)."""

from exposight.observing.masks import (
    FeatureView,
    View,
    Visibility,
    incidence_deg,
    orientation_deg,
    pose_columns,
    view_features,
)
from exposight.observing.observe import (
    RingBrightness,
    observe_campaign,
    observe_capture,
    ring_brightness,
)
from exposight.observing.point_search import PointSearch, point_search
from exposight.observing.recorded import Campaign, open_campaign
from exposight.observing.schema import REQUIRED, SCHEMA, Observation
from exposight.observing.table import ObservationTable
from exposight.observing.table_file import read_inputs, read_observations
