"""Who knows every outcome: the fewest captures, or the least time, that can serve all features."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp

from exposight.planning.comparing.strategies.contract import (
    FloatArray,
    Method,
    Setup,
    Trial,
    register,
)

_COUNT_FIRST = 1e4
"""A capture more costs more than any time saved."""


def least_cover(serves: NDArray[np.bool_], costs: FloatArray) -> list[int]:
    """Return the places of the captures that serve all that can be served, at least cost.

    Parameters
    ----------
    serves : (n, m) ndarray of bool
        Which of n features each of m captures serves.
    costs : (m,) ndarray
        What each capture costs, above 0.
    """
    rows = serves[serves.any(axis=1)]
    if not len(rows):
        return []
    chosen = milp(
        costs,
        integrality=np.ones(len(costs)),
        bounds=Bounds(0.0, 1.0),
        constraints=LinearConstraint(rows.astype(np.float64), lb=1.0),
    )
    return [int(place) for place in np.flatnonzero(chosen.x > 0.5)]


def _oracle(setup: Setup, first: float) -> Method:
    serves = {view.name: view.p_norm >= setup.sweep.need for view in setup.sweep.views}

    def measure(trial: Trial) -> None:
        times_ms = np.array([setup.costs.capture.capture_ms(t) for t in trial.settings_ms.tolist()])
        share = times_ms / times_ms.sum()
        for place in least_cover(serves[trial.view], first + share)[: trial.left]:
            trial.take(float(trial.settings_ms[place]))

    return measure


register(
    "oracle",
    "knows every outcome: the fewest captures, of those the quickest",
    lambda setup: _oracle(setup, _COUNT_FIRST),
    kind="oracle",
)
register(
    "oracle_time",
    "knows every outcome: the least time",
    lambda setup: _oracle(setup, 0.0),
    kind="oracle",
)
