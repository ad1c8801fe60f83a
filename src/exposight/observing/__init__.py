"""Captures to rows: p_norm, i_avg and pose of every feature (Sect. 3.1 of the paper)."""

from exposight.observing.brightness import ring_brightness
from exposight.observing.masks import (
    FeatureView,
    View,
    Visibility,
    incidence_deg,
    orientation_deg,
    pose_columns,
    tcp_text,
    view_features,
)
from exposight.observing.observe import (
    Campaign,
    Observer,
    observe_campaign,
    observe_capture,
    open_campaign,
)
from exposight.observing.point_search import PointSearch, point_search
from exposight.observing.readings import (
    n_visible,
    pose_contradictions,
    pose_that_fits,
    poses_in_view,
    reading_that_fits,
    why_not_visible,
)
from exposight.observing.schema import SCHEMA, Observation
from exposight.observing.table import (
    ObservationTable,
    parse_observations,
    read_inputs,
    read_observations,
)
