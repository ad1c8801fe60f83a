"""Ways to choose exposure times, each in a few lines, for `exposight.planning.compare`."""

from exposight.planning.comparing.strategies import (
    brackets,
    clusters,
    one_exposure,
    oracle,
    pixel_intervals,
    planned,
    regions,
    searching,
)
from exposight.planning.comparing.strategies.contract import (
    STRATEGIES,
    MeasuringCosts,
    Method,
    Setup,
    Strategy,
    Trial,
    register,
    strategies_named,
    strategy,
)
