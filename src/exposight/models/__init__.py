"""Rows to predictors: the paper's quality and exposure-time models, and their files."""

from exposight.errors import InputError
from exposight.models.exposure_time import EXPOSURE_TIME_MODELS, P_NORM_MIN
from exposight.models.model_file import MODEL_SUFFIX, is_model_file, load_model, save_model
from exposight.models.quality import I_AVG_MAX, I_AVG_MIN, QUALITY_MODELS
from exposight.models.specification import UNITS, ModelSpecification
from exposight.models.trained_model import (
    Evaluation,
    FitSummary,
    ModelPrediction,
    Provenance,
    TrainedModel,
    evaluate,
)
from exposight.models.training import Training, run_trainings, train, train_all

MODELS = (*QUALITY_MODELS, *EXPOSURE_TIME_MODELS)
"""Every model of the paper's Tables 2 and 3, in their order."""


def model_named(name: str) -> ModelSpecification:
    """Return the paper's model of this name.

    Raises
    ------
    InputError
        If there is none; the message lists them.
    """
    for specification in MODELS:
        if specification.name == name:
            return specification
    msg = f"no model '{name}'; expected one of {', '.join(s.name for s in MODELS)}"
    raise InputError(msg)
