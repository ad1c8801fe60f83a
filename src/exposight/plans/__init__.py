"""From where and for how long to measure, with any sensor; plans as files and by name."""

from exposight.plans.files import (
    PLAN_FORMAT,
    PLAN_SUFFIXES,
    plan_from_text,
    plan_to_toml,
    read_plan,
    write_plan,
)
from exposight.plans.plan import MeasuringPlan, PlannedView
from exposight.plans.pose_lists import PoseFrame, PoseList
from exposight.plans.positions import (
    TURN_AXES,
    DepthPlane,
    RandomPositions,
    even_positions,
    logarithmic_exposures,
    view_seed,
)
from exposight.plans.presets import PLANS, plan_preset
