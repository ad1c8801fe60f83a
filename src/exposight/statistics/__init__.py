"""Pure statistics: metrics of a regression, splits of its observations, dependence."""

from exposight.statistics.metrics import (
    RegressionScore,
    coverage,
    mae,
    mse,
    negative_log_predictive_density,
    r2,
    rmse,
    score,
)
from exposight.statistics.mic import (
    maximal_information_coefficient,
    maximal_information_matrix,
)
from exposight.statistics.splits import Split, inside_box, random_split, split_by_group
