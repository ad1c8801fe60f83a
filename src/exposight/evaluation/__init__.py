"""Pure statistics: metrics of a regression, splits of its observations, dependence."""

from exposight.evaluation.metrics import (
    Calibration,
    RegressionScore,
    calibration,
    coverage,
    mae,
    mse,
    negative_log_predictive_density,
    r2,
    rmse,
    score,
)
from exposight.evaluation.mic import (
    maximal_information_coefficient,
    maximal_information_matrix,
)
from exposight.evaluation.splits import Split, inside_box, random_split, split_by_group

__all__ = [
    "Calibration",
    "RegressionScore",
    "Split",
    "calibration",
    "coverage",
    "inside_box",
    "mae",
    "maximal_information_coefficient",
    "maximal_information_matrix",
    "mse",
    "negative_log_predictive_density",
    "r2",
    "random_split",
    "rmse",
    "score",
    "split_by_group",
]
