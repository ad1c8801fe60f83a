"""Captures to rows: p_norm, i_avg and pose of every feature (Sect. 3.1 of the paper)."""

from exposight.observing.masks import (
    FeatureView,
    Visibility,
    incidence_deg,
    orientation_deg,
    view_features,
)
from exposight.observing.observation import SCHEMA, Observation
from exposight.observing.observe import observe_campaign, observe_capture
from exposight.observing.point_search import PointSearch, point_search
from exposight.observing.table import ObservationTable, read_inputs, read_observations
