"""The fewest captures of one view that serve its features: a search along a path, proven optimal.

Captures of a view are a path t₁ < t₂ < … through its settings. The chance that a feature is served
is a sum over the path's arcs (`CaptureChances.gain`), whatever the dependence of its captures, and
what captures after a setting can add at most is known (`CaptureChances.later`); so a search in
depth leaves out whatever cannot reach what is asked, and is complete.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit
from exposight.planning.capture_chances import CaptureChances

FloatArray: TypeAlias = NDArray[np.float64]

Prefer = Literal["margin", "time"]
"""Among the fewest captures: those with the greatest least chance, or those that take least."""

_MARGIN, _TIME, _COVER = 0, 1, 2

_SLACK = 1e-9

_MOST_STEPS = 6_000_000
"""Looks at a feature in a node of the search; some 0.03 s."""

_TIE = 1e-3
"""Weight of the mean chance beside the least one."""

_ALIKE = 1e-4
"""Chances between which the most robust captures are not told apart."""


@dataclass(frozen=True)
class Path:
    """Settings that were chosen.

    Parameters
    ----------
    places : tuple of int
        Their places, ascending.
    proven : bool
        Whether no better choice exists: the search was complete.
    """

    places: tuple[int, ...]
    proven: bool


def fewest_captures(
    chances: CaptureChances,
    targets: FloatArray,
    costs: FloatArray,
    *,
    prefer: Prefer = "margin",
    least: int = 1,
    most: int,
) -> Path | None:
    """Return the fewest settings with which each feature reaches its target; None if too many.

    Parameters
    ----------
    chances : CaptureChances
        Of n features at m settings.
    targets : (n,) ndarray
        Chance that each feature needs; 0 where none does.
    costs : (m,) ndarray
        Of a capture at each setting; ascending.
    prefer : {"margin", "time"}
        Among the fewest: the most robust, or those that cost least.
    least, most : int
        Numbers of captures that may be taken.
    """
    arrays, proven = _arrays(chances, targets, costs), True
    for count in range(least, most + 1):
        ahead = _captures_ahead(chances, targets, count)
        if ahead[0] > count:
            continue
        code = _TIME if prefer == "time" else _MARGIN
        places, _, complete = _search(*arrays, ahead, count, code, _most_steps(targets))
        if count and places[0] >= 0:
            return Path(tuple(places.tolist()), proven and complete)
        proven &= complete
    return None


def cheapest_captures(
    chances: CaptureChances, targets: FloatArray, costs: FloatArray, *, most: int
) -> Path | None:
    """Return the settings that cost least in all, however many (`fewest_captures`)."""
    arrays = _arrays(chances, targets, costs)
    best, best_cost, proven = None, np.inf, True
    for count in range(1, most + 1):
        if costs[:count].sum() >= best_cost:
            break
        ahead = _captures_ahead(chances, targets, count)
        if ahead[0] > count:
            continue
        places, value, complete = _search(*arrays, ahead, count, _TIME, _most_steps(targets))
        proven &= complete
        if places[0] >= 0 and -value < best_cost - _SLACK:
            best, best_cost = tuple(places.tolist()), -value
    return None if best is None else Path(best, proven)


def most_served(
    chances: CaptureChances, targets: FloatArray, costs: FloatArray, *, count: int
) -> Path:
    """Return the settings, so many, with which most features reach their targets.

    Among equally many, those with most chance in all (`fewest_captures`).
    """
    count = min(count, len(costs))
    ahead = np.zeros(len(costs) + 1, dtype=np.int64)
    arrays = _arrays(chances, targets, costs)
    places, _, complete = _search(*arrays, ahead, count, _COVER, _most_steps(targets))
    return Path(tuple(places.tolist()), complete)


def _arrays(
    chances: CaptureChances, targets: FloatArray, costs: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    return (
        np.ascontiguousarray(chances.chance),
        chances.weights,
        np.ascontiguousarray(chances.begun),
        np.ascontiguousarray(chances.lasting),
        np.ascontiguousarray(chances.later),
        targets,
        costs,
    )


def _most_steps(targets: FloatArray) -> int:
    return max(1, _MOST_STEPS // len(targets))


def _captures_ahead(chances: CaptureChances, targets: FloatArray, count: int) -> NDArray[np.int64]:
    """Return how many captures are needed at least from each setting on, (m + 1,).

    A feature that `count` captures serve with its target's chance has at least one with a
    `count`-th of that; and one between two settings if the captures up to the one and from the
    other on cannot reach the target together. Such ranges that do not overlap need one capture
    each.
    """
    asked = targets > 0.0
    target, m = targets[asked, None], chances.chance.shape[1]
    ranges = np.concatenate(
        [
            chances.chance[asked] >= target / count - _SLACK,
            (chances.begins[asked] >= target / 2) & (chances.lasts[asked] >= target / 2),
        ]
    )
    ranges = ranges[ranges.any(axis=1)]
    first, last = ranges.argmax(axis=1), m - 1 - ranges[:, ::-1].argmax(axis=1)
    ends = np.full(m, m, dtype=np.int64)  # the nearest end of a range that begins there
    np.minimum.at(ends, first, last)
    nearest, ahead = np.minimum.accumulate(ends[::-1])[::-1].tolist(), [0] * (m + 1)
    for i in range(m - 1, -1, -1):
        ahead[i] = 0 if nearest[i] == m else ahead[nearest[i] + 1] + 1
    return np.array(ahead)


@njit()
def _search(
    chance: FloatArray,
    weights: FloatArray,
    begun: FloatArray,
    lasting: FloatArray,
    later: FloatArray,
    targets: FloatArray,
    costs: FloatArray,
    ahead: NDArray[np.int64],
    count: int,
    prefer: int,
    most_steps: int,
) -> tuple[NDArray[np.int64], float, bool]:  # pragma: no cover - compiled
    """Return the best `count` places (−1 if none will do), their value, and if that is proven."""
    n, m = chance.shape
    gain = np.zeros((m if count > 1 else 0, n, m))  # of each first setting once it is looked at
    known = np.zeros(m, dtype=np.bool_)
    best = np.full(count, -1, dtype=np.int64)
    best_value = -np.inf
    place = np.full(count, -1, dtype=np.int64)
    total = np.zeros((count + 1, n))
    cost = np.zeros(count + 1)
    depth, steps = 0, 0
    while depth >= 0:
        place[depth] += 1
        i = place[depth]
        if i > m - (count - depth):
            depth -= 1
            continue
        steps += 1
        if steps > most_steps:
            return best, best_value, False
        leaf = depth == count - 1
        if ahead[i + 1] > count - depth - 1:
            continue
        cost[depth + 1] = cost[depth] + costs[i]
        bound, mean, reached = np.inf, 0.0, 0.0
        for f in range(n):
            value = chance[f, i]
            if depth > 0:
                value = total[depth, f] + gain[place[depth - 1], f, i]
            total[depth + 1, f] = value
            reach = value if leaf else min(value + later[f, i], 1.0)
            mean += reach
            if targets[f] > 0.0:
                if prefer == _COVER:
                    reached += 1.0 if reach >= targets[f] - _SLACK else 0.0
                    mean += min(reach, targets[f]) - reach
                elif reach < targets[f] - _SLACK:
                    bound = -np.inf
                    break
                elif reach < bound:
                    bound = reach
        if prefer == _MARGIN:
            bound = min(bound, 1.0) + _TIE * mean / n
        elif prefer == _COVER:
            bound = reached + _TIE * mean / n
        elif bound > -np.inf:
            bound = -(cost[depth + 1] + (count - depth - 1) * costs[min(i + 1, m - 1)])
        if bound <= best_value + (_ALIKE if prefer == _MARGIN else _SLACK):
            continue
        if leaf:
            best_value = bound
            best[:] = place
        else:
            if not known[i]:
                known[i] = True
                _gains_after(chance, weights, begun, lasting, i, gain[i])
            place[depth + 1] = i
            depth += 1
    return best, best_value, True


@njit()
def _gains_after(
    chance: FloatArray,
    weights: FloatArray,
    begun: FloatArray,
    lasting: FloatArray,
    first: int,
    out: FloatArray,
) -> None:  # pragma: no cover - compiled
    """Fill in what captures after a first one add to it (`CaptureChances.gain`), (n, m)."""
    n, m = chance.shape
    for i in range(n):
        for t in range(first + 1, m):
            both = min(chance[i, first], chance[i, t]) if len(weights) == 0 else 0.0
            for k in range(len(weights)):
                both += weights[k] * begun[i, k, first] * lasting[i, k, t]
            out[i, t] = max(chance[i, t] - both, 0.0)
