"""Brightness in clusters, one exposure for each (Sensors 2025, 25(15), 4786)."""

from __future__ import annotations

from itertools import product

import numpy as np

from exposight.planning.comparing.strategies.contract import FloatArray, Method, Trial, register
from exposight.planning.comparing.strategies.region_light import radiances
from exposight.planning.comparing.strategies.rehearsal import best_of
from exposight.tables import counted

_FIRST_MS = (10.0, 40.0)
_TARGETS = (30.0, 40.0, 50.0, 60.0, 70.0, 85.0)


def clustered(first_ms: float, target: float, count: int) -> Method:
    """Bring the centre of each of some clusters of brightness to a grey level."""

    def measure(trial: Trial) -> None:
        centres = means(np.log(radiances(trial, first_ms)), count)
        trial.take_all(sorted((target / np.exp(centres)).tolist()))

    return measure


def means(values: FloatArray, count: int) -> FloatArray:
    """Return the centres of k-means clusters of numbers, starting from evenly spread quantiles.

    A cluster that loses all its members goes.
    """
    centres = np.unique(np.quantile(values, (np.arange(count) + 0.5) / count))
    while True:
        nearest = np.abs(values[:, None] - centres).argmin(axis=1)
        moved = np.array([values[nearest == place].mean() for place in np.unique(nearest)])
        if len(moved) == len(centres) and np.allclose(moved, centres):
            return moved
        centres = moved


for _count in (1, 2, 3):
    register(
        f"clusters_{_count}",
        f"trial images; brightness in {counted(_count, 'cluster')} by k-means",
        best_of(clustered, list(product(_FIRST_MS, _TARGETS, (_count,)))),
    )
