"""From where, for how long and in which light to measure; plans as files and by name."""

from exposight.twin.plans.alignment import AlignedBy, AlignmentErrors, draw_alignment
from exposight.twin.plans.files import (
    PLAN_FORMAT,
    PLAN_SUFFIXES,
    PLAN_VERSION,
    plan_from_toml,
    plan_from_yaml,
    plan_to_toml,
    read_plan,
    write_plan,
)
from exposight.twin.plans.plan import BlindViews, DepthPlane, MeasuringPlan, RandomPositions, Side
from exposight.twin.plans.planned_views import PlannedView, views
from exposight.twin.plans.presets import PLANS, plan_preset
from exposight.twin.plans.spacing import even_positions, logarithmic_exposures

__all__ = [
    "PLANS",
    "PLAN_FORMAT",
    "PLAN_SUFFIXES",
    "PLAN_VERSION",
    "AlignedBy",
    "AlignmentErrors",
    "BlindViews",
    "DepthPlane",
    "MeasuringPlan",
    "PlannedView",
    "RandomPositions",
    "Side",
    "draw_alignment",
    "even_positions",
    "logarithmic_exposures",
    "plan_from_toml",
    "plan_from_yaml",
    "plan_preset",
    "plan_to_toml",
    "read_plan",
    "views",
    "write_plan",
]
