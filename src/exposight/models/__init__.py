"""Rows to predictors: the contract, the paper's quality and exposure-time models, their files."""

from exposight.models.evaluation import Evaluation, ProbabilityScore, evaluate, unit_remarks
from exposight.models.gaussian_process import FitSummary, GaussianProcessModel
from exposight.models.model_file import (
    MODEL_SUFFIX,
    is_model_file,
    load_model,
    model_sha256,
    save_model,
)
from exposight.models.prediction import Prediction
from exposight.models.predictor import (
    Hyperparameter,
    Predictor,
    Provenance,
    input_array,
    register_predictor,
)
from exposight.models.proposals import CaptureProposer, propose_captures
from exposight.models.radiance_model import EXPOSURE, QUALITY, RadianceModel
from exposight.models.radiance_search import MeanKind
from exposight.models.response_curve import Better
from exposight.models.ring_data import black_level_of
from exposight.models.ring_forecast import RingForecast, best_exposure
from exposight.models.ring_training import keeps_limits, train_response, train_window
from exposight.models.specification import (
    EXPOSURE_TIME_MODELS,
    I_AVG_MIN,
    MODELS,
    P_NORM_MIN,
    QUALITY_MODELS,
    ModelSpecification,
    model_named,
    product_kernel,
)
from exposight.models.training import Training, run_trainings, train_all
from exposight.models.window_model import WindowModel
