"""One exposure for the whole view, as automatic exposure chooses it from an image's histogram."""

from __future__ import annotations

import numpy as np

from exposight.planning.comparing.strategies.contract import Method, Trial, register
from exposight.planning.comparing.strategies.region_light import radiances
from exposight.planning.comparing.strategies.rehearsal import best_of

_FIRST_MS = (10.0, 40.0)
_TARGETS = (30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 100.0, 120.0, 150.0, 180.0, 220.0)
"""Grey levels above black that mean or percentile is brought to."""

_PERCENT = 99.0


def mean_grey(first_ms: float, target: float) -> Method:
    """Bring the mean of all rings' pixels to a grey level."""

    def measure(trial: Trial) -> None:
        pixels = np.nan_to_num(trial.poses["n_pixels"].cast(float).to_numpy(), nan=1.0)
        value = radiances(trial, first_ms)
        trial.take(trial.nearest(target / float(np.average(value, weights=pixels))))

    return measure


def high_percentile(first_ms: float, target: float) -> Method:
    """Bring the brightest percent of the rings to a grey level."""

    def measure(trial: Trial) -> None:
        bright = float(np.percentile(radiances(trial, first_ms), _PERCENT))
        trial.take(trial.nearest(target / bright))

    return measure


_CHOICES = [(first, target) for first in _FIRST_MS for target in _TARGETS]

register(
    "mean_grey", "one exposure that brings the mean to a grey level", best_of(mean_grey, _CHOICES)
)
register(
    "high_percentile",
    "one exposure that brings the 99th percentile to a grey level",
    best_of(high_percentile, _CHOICES),
)
