"""Brightness in clusters, one exposure for each (Sensors 2025, 25(15), 4786)."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.cluster.vq import kmeans2

from exposight.planning.strategies.contract import Method, Trial, register
from exposight.planning.strategies.region_light import radiances
from exposight.planning.strategies.rehearsal import best_of
from exposight.tables import counted

_FIRST_MS = (10.0, 40.0)
_TARGETS = (30.0, 40.0, 50.0, 60.0, 70.0, 85.0)


def clustered(first_ms: float, target: float, count: int) -> Method:
    """Bring the centre of each of some clusters of brightness to a grey level."""

    def measure(trial: Trial) -> None:
        value = np.log(radiances(trial, first_ms))
        clusters = min(count, len(np.unique(value)))
        start = np.quantile(value, (np.arange(clusters) + 0.5) / clusters)
        centres, _ = kmeans2(value, start, minit="matrix", missing="warn", rng=1)
        trial.take_all(sorted((target / np.exp(centres)).ravel().tolist()))

    return measure


for _count in (1, 2, 3):
    register(
        f"clusters_{_count}",
        f"trial images; brightness in {counted(_count, 'cluster')} by k-means",
        best_of(clustered, list(product(_FIRST_MS, _TARGETS, (_count,)))),
    )
