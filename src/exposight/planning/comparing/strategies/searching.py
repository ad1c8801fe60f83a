"""Look, act, assess without a model: what each capture shows decides the next one.

A feature that was not had is scaled to grey levels between which others are; one that is too dark
or clips tells on which side its exposure lies.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from exposight.planning.comparing.strategies.contract import Method, Trial, register
from exposight.planning.comparing.strategies.region_light import DARK, brightness
from exposight.planning.comparing.strategies.rehearsal import best_of

_FIRST_MS = (12.0, 20.0, 31.0, 54.0, 90.0)
_LOWEST, _HIGHEST = (16.0, 20.0, 25.0), (85.0, 100.0, 115.0)
_REACH = 12.0
"""Ratio of exposure times beyond which a dark or clipped feature is not looked for at first."""

_MOST = 8
"""Captures at most."""


def adaptive(first_ms: float, low: float, high: float) -> Method:
    """Take what serves most of what is left, by the brightness of the captures so far."""

    def measure(trial: Trial) -> None:
        n, settings = len(trial.features), trial.settings_ms
        least, most = np.zeros(n), np.full(n, np.inf)
        next_ms = trial.nearest(first_ms)
        while trial.left and len(trial.captures_ms) < _MOST:
            grey, clipped = brightness(trial.take(next_ms))
            above = grey - trial.black_level
            dark = ~clipped & (above < DARK)
            clear = ~clipped & ~dark
            scaled = next_ms / np.maximum(above, 1.0)
            least[clear], most[clear] = low * scaled[clear], high * scaled[clear]
            least[dark] = np.maximum(least[dark], next_ms)
            most[clipped] = np.minimum(most[clipped], next_ms)
            waiting = np.array([name not in trial.had for name in trial.features])
            free = ~np.isin(settings, trial.captures_ms)
            if not waiting.any() or not free.any():
                return
            lower = np.where(least > 0.0, least, most / _REACH)
            upper = np.where(np.isfinite(most), most, least * _REACH)
            serves = (settings >= lower[:, None]) & (settings <= upper[:, None])
            votes = np.where(free, serves[waiting].sum(axis=0), -1)
            if votes.max() < 1:
                return
            best = np.flatnonzero(votes == votes.max())
            next_ms = float(settings[best[len(best) // 2]])

    return measure


register(
    "adaptive",
    "no model; each capture's brightness decides the next one",
    best_of(adaptive, list(product(_FIRST_MS, _LOWEST, _HIGHEST))),
)
