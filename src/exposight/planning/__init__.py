"""Predictors to decisions: what to expect of a view before anything is taken there."""

from exposight.planning.capture_chances import CaptureChances
from exposight.planning.chain import ChainedQuality, chained_forecast, with_chains
from exposight.planning.comparing.comparison import Comparison, compare
from exposight.planning.comparing.comparison_files import read_comparison, write_comparison
from exposight.planning.comparing.strategies import Setup, Strategy, Trial, strategy
from exposight.planning.comparing.sweeps import Sweep
from exposight.planning.covering.cover import plan_exposures
from exposight.planning.covering.trade_off import trade_off
from exposight.planning.exposure_limits import PROFILES, CaptureCosts, ExposureLimits, limits_named
from exposight.planning.exposure_plan import (
    Certificate,
    ExposurePlan,
    Goal,
    ModelReference,
    PlanView,
    Promise,
    parse_exposure_plan,
    read_exposure_plan,
    write_exposure_plan,
)
from exposight.planning.forecasts import LIKELY, WANTED_BRIGHTNESS, Forecast
from exposight.planning.model_scores import ModelScores
from exposight.planning.outlook import FeatureOutlook, PlannedExposure
from exposight.planning.part_plan import plan, view_chances
from exposight.planning.path_search import Prefer
from exposight.planning.recommendation import (
    CONFIDENCE,
    Recommendation,
    check_confidence,
    recommend,
)
from exposight.planning.sensor_models import DEFAULT_MODELS, SensorModels
from exposight.planning.sensor_training import train
