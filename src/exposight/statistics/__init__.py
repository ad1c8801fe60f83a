"""Pure statistics: metrics of a regression, splits of its observations, dependence."""

from exposight.statistics.metrics import RegressionScore, coverage, mae, mse, r2, rmse, score
from exposight.statistics.mic import characteristic_matrix, maximal_information_matrix
from exposight.statistics.probability import (
    LEVELS,
    ChanceBin,
    brier,
    crps,
    log_score,
    reliability,
)
from exposight.statistics.splits import Split, inside_box, random_split, split_by_group
