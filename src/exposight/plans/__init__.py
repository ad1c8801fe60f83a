"""From where, for how long and in which light to measure; plans as files and by name."""

from exposight.plans.alignment import AlignedBy, AlignmentErrors, draw_alignment
from exposight.plans.files import (
    PLAN_FORMAT,
    PLAN_SUFFIXES,
    PLAN_VERSION,
    plan_from_toml,
    plan_from_yaml,
    plan_to_toml,
    read_plan,
    write_plan,
)
from exposight.plans.plan import BlindViews, DepthPlane, MeasuringPlan, RandomPositions, Side
from exposight.plans.planned_views import PlannedView, views
from exposight.plans.presets import PLANS, plan_preset
from exposight.plans.spacing import even_positions, logarithmic_exposures
