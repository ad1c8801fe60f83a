"""The fewest exposures from each pixel's own interval, chosen greedily (after Feng L. 2024).

Two captures tell each pixel's maximum and modulation; light is linear, so they tell between which
exposure times it is neither too dark nor clipped. An observation table holds percentiles of a
ring's pixels instead of the pixels, and each stands here for its share of them.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from exposight.errors import ObservationError
from exposight.observing import ObservationTable
from exposight.planning.comparing.strategies.contract import FloatArray, Method, Trial, register
from exposight.planning.comparing.strategies.rehearsal import best_of
from exposight.quantities import STACK_PERCENTS

_MAXIMUM = tuple(f"i_max_p{each:02d}" for each in STACK_PERCENTS)
_MODULATION = tuple(f"i_mod_p{each:02d}" for each in STACK_PERCENTS)
_MOST = 7
"""Captures at most, the two first ones among them."""

_FULL, _LEAST = 250.0, 18.0
"""Grey levels: a brightest frame that does not clip, and a modulation that decodes well."""

_PAIRS_MS = ((8.0, 60.0), (15.0, 100.0), (30.0, 200.0))


def pixel_intervals(pair_ms: tuple[float, float], share: float) -> Method:
    """Take a short and a long capture, then what serves most pixels, until a share is served."""

    def measure(trial: Trial) -> None:
        low = np.zeros((len(trial.features), len(STACK_PERCENTS)))
        high = np.full_like(low, np.inf)
        times_ms = trial.settings_ms
        for exposure_ms in dict.fromkeys(map(trial.nearest, pair_ms)):
            if trial.left:
                _narrow(low, high, exposure_ms, trial.take(exposure_ms), trial.black_level)
        serves = (times_ms >= low[..., None]) & (times_ms <= high[..., None])
        taken = np.isin(times_ms, trial.captures_ms)
        served: NDArray[np.bool_] = np.asarray(serves[..., taken].any(axis=-1))
        while served.mean() < share and trial.left and len(trial.captures_ms) < _MOST:
            gain = (serves & ~served[..., None]).sum(axis=(0, 1))
            if not gain.max():
                return
            best = np.flatnonzero(gain == gain.max())
            place = best[len(best) // 2]
            trial.take(float(times_ms[place]))
            served |= serves[..., place]

    return measure


def _narrow(
    low: FloatArray, high: FloatArray, exposure_ms: float, rows: ObservationTable, black: float
) -> None:
    """Narrow intervals, in place, by what a capture shows of each percentile."""
    maximum, modulation = rows.array(_MAXIMUM), rows.array(_MODULATION)
    if np.isnan(maximum).any() or np.isnan(modulation).any():
        msg = (
            "pixel_intervals needs what captures keep of their frame stack (i_max_p05 …); the "
            "sweep has none: compare without this strategy, or observe a campaign with stacks"
        )
        raise ObservationError(msg)
    clips = maximum >= _FULL
    at_full = exposure_ms * (_FULL - black) / np.maximum(maximum - black, 1.0)
    high[:] = np.where(clips, np.minimum(high, exposure_ms * 0.999), np.minimum(high, at_full))
    clear = ~clips & (modulation >= 1.0)
    at_least = exposure_ms * _LEAST / np.maximum(modulation, 0.5)
    low[:] = np.where(clear, np.maximum(low, at_least), low)
    low[:] = np.minimum(low, high)


register(
    "pixel_intervals",
    "two captures; then greedily the intervals of each pixel",
    best_of(pixel_intervals, list(product(_PAIRS_MS, (0.8, 0.9, 0.97)))),
)
