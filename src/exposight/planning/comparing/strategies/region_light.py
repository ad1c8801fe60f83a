"""What images tell strategies that know no model: each feature's light, and intervals from it."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.observing import ObservationTable
from exposight.planning.comparing.strategies.contract import Trial

FloatArray: TypeAlias = NDArray[np.float64]

DARK = 4.0
"""Grey levels above black up to which brightness tells no radiance."""

CLIPPED = 0.02
"""Share of clipped pixels from which it tells none either."""

_FULL = 255.0

_STEP = 8.0
"""A trial image too dark or too bright is repeated at so many times or shares of its exposure."""

_IMAGES = 4
"""Trial images at most."""


def brightness(rows: ObservationTable) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return each feature's mean grey level, (n,), and whether it clips."""
    mean, average, clipped = rows.array(("i_mean", "i_avg", "clipped_share")).T
    return np.where(np.isnan(mean), average, mean), np.nan_to_num(clipped) > CLIPPED


def radiances(trial: Trial, first_ms: float) -> FloatArray:
    """Return each feature's grey levels above black per ms, from as few trial images as need be.

    Features too dark or clipped in one image are looked at again in a longer or shorter one; what
    stays so takes the value that it has at least or at most.

    Parameters
    ----------
    trial : Trial
    first_ms : float, ms
        Exposure time of the first image.
    """
    value = np.full(len(trial.features), np.nan)
    bound = value.copy()
    queue = [trial.nearest(first_ms)]
    while queue and len(trial.trial_images_ms) < _IMAGES:
        exposure_ms = queue.pop(0)
        grey, clipped = brightness(trial.trial(exposure_ms))
        above = np.maximum(grey - trial.black_level, 0.5)
        missing = np.isnan(value)
        bright, dark = missing & clipped, missing & ~clipped & (above < DARK)
        clear = missing & ~bright & ~dark
        value[clear] = above[clear] / exposure_ms
        bound[bright] = _FULL / exposure_ms
        bound[dark] = above[dark] / exposure_ms
        for wrong, factor in ((dark, _STEP), (bright, 1.0 / _STEP)):
            if wrong.any():
                next_ms = trial.nearest(exposure_ms * factor)
                if next_ms not in (*trial.trial_images_ms, *queue):
                    queue.append(next_ms)
    return np.where(np.isnan(value), bound, value)


def middles(trial: Trial, low_ms: FloatArray, high_ms: FloatArray) -> list[float]:
    """Return the fewest allowed exposure times that lie in intervals, one in each.

    Intervals are grouped by their ends, the earliest first, and each group takes the setting in the
    middle of what its intervals share. An interval without a setting takes the nearest one.
    """
    chosen = []
    low, high = np.log(low_ms), np.log(high_ms)
    settings = np.log(trial.settings_ms)
    holds = (settings >= low[:, None]) & (settings <= high[:, None])
    for i in np.flatnonzero(~holds.any(axis=1)):
        holds[i, np.abs(settings - 0.5 * (low[i] + high[i])).argmin()] = True
    left = np.ones(len(low), dtype=np.bool_)
    while left.any():
        last = min(int(np.flatnonzero(row)[-1]) for row in holds[left])
        group = left & holds[:, last]
        shared = np.flatnonzero(holds[group].all(axis=0))
        chosen.append(float(trial.settings_ms[shared[len(shared) // 2]]))
        left &= ~group
    return chosen
