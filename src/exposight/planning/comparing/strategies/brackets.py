"""Brackets: the same exposures for every view, in geometric or arithmetic progression.

Zhang & Yau, "High dynamic range scanning technique", Optical Engineering 48 (2009), and the advice
of vendors.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np

from exposight.planning.comparing.strategies.contract import (
    FloatArray,
    Method,
    Setup,
    Trial,
    register,
)
from exposight.planning.comparing.strategies.rehearsal import best_of

_ENDS = 16
"""Exposure times among which a bracket's ends are chosen."""


def bracket(times_ms: FloatArray) -> Method:
    """Take the same exposures in every view."""

    def measure(trial: Trial) -> None:
        trial.take_all(times_ms.tolist())

    return measure


def _start(
    spaced: Callable[[float, float, int], FloatArray], count: int
) -> Callable[[Setup], Method]:
    def start(setup: Setup) -> Method:
        settings = np.unique(np.concatenate([v.settings_ms for v in setup.rehearsal.views]))
        ends = settings[np.linspace(0, len(settings) - 1, min(_ENDS, len(settings))).astype(int)]
        choices = [spaced(low, high, count) for low, high in combinations(ends.tolist(), 2)]
        whole = [times for times in choices if _distinct(times, settings) == count]
        return best_of(bracket, [(times,) for times in whole or choices])(setup)

    return start


def _distinct(times_ms: FloatArray, settings_ms: FloatArray) -> int:
    """Return how many different settings are nearest to exposure times."""
    apart = np.abs(np.log(times_ms)[:, None] - np.log(settings_ms))
    return len(np.unique(apart.argmin(axis=1)))


for _count in (2, 3, 5):
    for _word, _spaced in (("geometric", np.geomspace), ("arithmetic", np.linspace)):
        register(
            f"{_word}_{_count}",
            f"{_count} exposures in {_word} progression",
            _start(_spaced, _count),
        )
