"""How many captures a view will need after the next one, whatever its windows turn out to be.

Windows are drawn jointly from what is believed of them; draws that contradict what was missed
already are replaced.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]

DRAWS = 256
"""Of windows."""
_SCENARIOS = 64
"""Draws in each of which the captures that are left are counted."""

_FEWEST_DRAWS = 8
"""So many draws must agree with what a feature missed; otherwise its window lies elsewhere."""

_SURE = 0.9
"""Share of a feature's best chance at which a setting counts as one that serves it."""

_LIKELY = 0.5
"""Features that a capture should be expected to serve, where there is one that serves so many."""

_EXTRA = 1e-2
"""Weight of features that are planned elsewhere."""

_BESIDE = 0.15
_ELSEWHERE = 0.6
"""Standard deviations of ln exposure time about a window that was not where it was expected."""


def served_in_draws(
    windows_ms: FloatArray,
    settings_ms: FloatArray,
    missed_ms: Sequence[Sequence[float]],
    rng: np.random.Generator,
) -> BoolArray:
    """Return in which draws each setting serves each feature, (d, n, m).

    Parameters
    ----------
    windows_ms : (d, n, 2) ndarray, ms
        Windows of n features, drawn jointly d times.
    settings_ms : (m,) ndarray, ms
        Exposure times.
    missed_ms : sequence of sequence of float, ms
        Exposure times by which each feature was missed.
    rng : numpy.random.Generator
    """
    n_draws = len(windows_ms)
    served = _within(windows_ms, settings_ms)
    for i, missed in enumerate(missed_ms):
        if not missed:
            continue
        times = np.array(missed)
        agrees = ~_within(windows_ms[:, i : i + 1], times).any(axis=(1, 2))
        agrees &= np.isfinite(windows_ms[:, i, 0])
        kept = np.flatnonzero(agrees)
        if len(kept) >= _FEWEST_DRAWS:
            chosen = np.where(agrees, np.arange(n_draws), rng.choice(kept, n_draws))
            served[:, i] = served[chosen, i]
            continue
        # a little beside where it was expected, or somewhere else
        std = np.where(rng.random((n_draws, 1)) < 0.5, _BESIDE, _ELSEWHERE)
        moved = windows_ms[:, i] * np.exp(std * rng.standard_normal((n_draws, 1)))
        elsewhere = ~_within(moved[:, None], times).any(axis=(1, 2))
        elsewhere &= rng.random(n_draws) < 0.5 ** (len(missed) - 1)  # that it can be had at all
        served[:, i] = _within(moved[:, None], settings_ms)[:, 0] & elsewhere[:, None]
    return served


def served_between(
    windows_ms: FloatArray,
    settings_ms: FloatArray,
    tries: Sequence[tuple[float, str]],
    rng: np.random.Generator,
) -> BoolArray | None:
    """Return in which draws each setting serves a feature that was once dark and once clipped.

    Whatever is believed of it, its window lies between the two, if it has one.

    Parameters
    ----------
    windows_ms : (d, 2) ndarray, ms
        Its windows, drawn d times; how wide they are is kept.
    settings_ms : (m,) ndarray, ms
        Exposure times.
    tries : sequence of (float, str)
        Exposure times in ms by which it was missed, each "dark", "clips" or neither.
    rng : numpy.random.Generator

    Returns
    -------
    (d, m) ndarray of bool or None
        None where it was not both, or dark at the longer time.
    """
    dark = max((ms for ms, lit in tries if lit == "dark"), default=0.0)
    clips = min((ms for ms, lit in tries if lit == "clips"), default=np.inf)
    if not 0.0 < dark < clips < np.inf:
        return None
    span = np.log(clips / dark)
    width = np.minimum(np.log(windows_ms[:, 1] / windows_ms[:, 0]), span)
    start = np.log(dark) + rng.random(len(windows_ms)) * (span - width)
    between = np.exp(np.stack([start, start + width], axis=1))
    had = rng.random(len(windows_ms)) < 0.5 ** (len(tries) - 1)  # that it can be had at all
    return np.asarray(_within(between[:, None], settings_ms)[:, 0] & had[:, None])


def after_misses(
    chance: FloatArray, settings_ms: FloatArray, missed_ms: Sequence[Sequence[float]]
) -> FloatArray:
    """Return chances of models without windows, less what was missed, (n, m).

    What was missed at one exposure time is hardly had at a similar one.
    """
    out = chance.copy()
    for i, missed in enumerate(missed_ms):
        for each in missed:
            out[i] *= np.clip(np.abs(np.log(settings_ms / each)) / _ELSEWHERE, 0.0, 1.0)
    return out


def best_place(
    chance: FloatArray,
    served: BoolArray | None,
    fresh: BoolArray,
    costs: FloatArray | None,
    extra: FloatArray,
) -> int:
    """Return the setting after which fewest captures, or least cost, are to be expected.

    Of equally good ones that which serves most features, and of these the middle one.

    Parameters
    ----------
    chance : (n, m) ndarray
        That a capture at each of m settings serves each of n features.
    served : (d, n, m) ndarray of bool or None
        In which draws it does; None of models without windows.
    fresh : (m,) ndarray of bool
        Settings that were not taken yet.
    costs : (m,) ndarray or None
        Of a capture at each setting, not falling; None to count captures.
    extra : (m,) ndarray
        Further features to expect, which are planned elsewhere.
    """
    expected = chance.sum(axis=0)
    if served is None:
        cost = -expected if costs is None else -expected / costs
    elif costs is None:
        cost = 1.0 + captures_left(served)
    else:
        cost = costs + cost_left(served, costs)
    # what a capture that serves nobody would teach is not relied on
    least = min(_LIKELY, float(expected[fresh].max(initial=0.0)))
    cost = np.where(fresh & (expected >= least), cost, np.inf)
    near = cost <= cost.min() + 1e-9 * abs(cost.min())
    score = np.where(near, expected + _EXTRA * extra, -np.inf)
    alike = np.flatnonzero(score >= score.max() - 1e-3)
    return int(alike[len(alike) // 2])


def captures_left(served: BoolArray) -> FloatArray:
    """Return the mean number of captures that are needed after one at each setting, (m,).

    As if that one told all that is uncertain, which it nearly does.

    Parameters
    ----------
    served : (d, n, m) ndarray of bool
        In which draws each setting serves each feature. Those that none serves do not count.
    """
    some = np.ascontiguousarray(served[:_SCENARIOS])
    return _cost_left(some, some, np.ones(some.shape[2]))


def cost_left(served: BoolArray, costs: FloatArray) -> FloatArray:
    """Return the mean cost of the captures that are needed after one at each setting, (m,).

    As if that one told nothing: a short capture tells little of what needs a long one.

    Parameters
    ----------
    served : (d, n, m) ndarray of bool
        In which draws each setting serves each feature. Those that none serves do not count.
    costs : (m,) ndarray
        Of a capture at each setting, not falling.
    """
    some = np.ascontiguousarray(served[:_SCENARIOS])
    chance = served.mean(axis=0)
    sure = (chance >= _SURE * chance.max(axis=1, keepdims=True)) & (chance > 0.0)
    return _cost_left(some, sure[None], costs)


def _within(windows_ms: FloatArray, settings_ms: FloatArray) -> BoolArray:
    """Return which settings lie in which windows, (d, n, m); none in a window that is NaN."""
    low, high = windows_ms[..., 0, None], windows_ms[..., 1, None]
    out: BoolArray = (low <= settings_ms) & (settings_ms <= high)
    return out


@njit()
def _cost_left(
    served: BoolArray, windows: BoolArray, costs: FloatArray
) -> FloatArray:  # pragma: no cover - compiled
    """Add up the captures of sweeps from the left over the windows of what is not served.

    Windows are intervals, so the sweep that takes the last setting of the first window to end needs
    fewest captures; each is then moved to the first setting that serves the same windows.
    """
    draws, n, m = served.shape
    total = np.zeros(m)
    first, last = np.empty(n, np.int64), np.empty(n, np.int64)
    for d in range(draws):
        for i in range(n):
            first[i], last[i] = m, -1
            for j in range(m):
                if windows[min(d, len(windows) - 1), i, j]:
                    first[i] = min(first[i], j)
                    last[i] = j
        order = np.argsort(last)
        for t in range(m):
            at, earliest = -1, -1
            for k in range(n):
                i = order[k]
                if last[i] < 0 or served[d, i, t]:
                    continue
                if first[i] > at:
                    if at >= 0:
                        total[t] += costs[earliest]
                    at, earliest = last[i], first[i]
                else:
                    earliest = max(earliest, first[i])
            if at >= 0:
                total[t] += costs[earliest]
    return total / draws
