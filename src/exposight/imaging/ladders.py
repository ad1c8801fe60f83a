"""How phases of several fringes become one absolute coordinate, and by which steps best.

The phases φ_i of fringes with p_i periods over the projector, each known up to whole periods, give
for whole numbers k_i a phase Σk_i·φ_i of Σk_i·p_i periods, a beat. A beat of one period or less is
absolute; a finer phase is unwrapped by it, a still finer one by that, until the finest fringe
(Reich, Ritter & Thesing, *White light heterodyne principle for 3D-measurement*, SPIE 3100, 1997;
Towers, Towers & Jones, *Optimum frequency selection in multifrequency interferometry*, Optics
Letters 2003).

In a step from the combination a of f_a periods to b of f_b, the order of b is right while the error
of f_b/f_a·φ_a − φ_b stays below half a period. Its standard deviation is that of the phases, times
the length of the vector f_b/f_a·k_a − k_b: it is what the best ladder keeps small.
"""

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache, reduce
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from exposight.errors import ImageError

_NOISE = 0.02
"""σ_I/B by which steps are judged: 2 grey levels of noise on an amplitude of 100. Ladders of
phases alone do not depend on it; it weighs them against the width of a Gray code."""
_LARGEST_SUMS = {1: 1, 2: 14, 3: 9, 4: 6, 5: 4}
"""Largest Σ|k_i| by number of fringes; 3 from six on. Larger numbers amplify noise until no order
is right, or are not needed."""
_AS_GOOD = 1.1
"""A ladder whose worst step is larger by no more than this is as good as the best."""
_LEAST_MARGIN = 3.0
"""Half a period over the standard deviation, below which no beat is trusted."""


@dataclass(frozen=True)
class Ladder:
    """Steps of unwrapping, from coarse to the finest fringe.

    Parameters
    ----------
    combinations : tuple of tuple of int
        k of every step, one number a fringe. The last `n_checks` unwrap nothing: they are fringes
        that no step uses alone, held against the result.
    n_checks : int
        Number of these.
    deviation : float, periods
        Standard deviation of the worst step between phases, at a noise of 2 % of the amplitude.
    """

    combinations: tuple[tuple[int, ...], ...]
    n_checks: int
    deviation: float


@lru_cache(maxsize=256)
def unwrapping_ladder(
    periods: tuple[float, ...], steps: tuple[int, ...], size: int, code_width: int | None = None
) -> Ladder:
    """Choose the steps whose worst one has the largest margin.

    Parameters
    ----------
    periods : tuple of float
        Periods of every fringe over the projector, ascending.
    steps : tuple of int
        Number of phase shifts of every fringe: a phase has the variance 2/N·(σ_I/B)².
    size : int, px
        The projector's length along the axis.
    code_width : int, px, optional
        Of the Gray code from which the first phase is unwrapped; without it the first combination
        has at most one period.

    Returns
    -------
    Ladder
        Its last step is the finest fringe alone.

    Raises
    ------
    ImageError
        If no combination of small whole numbers is coarse enough, or only by noise's grace.
    """
    numbers, frequencies = _combinations(periods)
    coarsest = 1.0 if code_width is None else size / code_width
    first = frequencies <= coarsest * (1.0 + 1e-9)
    if not first.any():
        raise ImageError(_ambiguous(periods, size, code_width))
    per_phase = _NOISE / (2.0 * math.pi) * np.sqrt(2.0 / np.array(steps))
    entry = np.where(first, 0.0, np.inf)
    if code_width is not None:  # uniform over the code's width
        entry[first] = frequencies[first] / coarsest / math.sqrt(12.0)
    deviation = _deviations(numbers, frequencies, per_phase)
    target = _single(numbers, len(periods) - 1)
    worst = _best_path(deviation, entry, np.maximum)[0][target]
    entry[entry > _AS_GOOD * worst] = np.inf
    between = _best_path(deviation, np.where(np.isfinite(entry), 0.0, np.inf), np.maximum)[0]
    limit = _AS_GOOD * between[target]
    # Of the ladders that are as good, the one of fewest steps, then of smallest ones.
    cost = np.where(deviation <= limit, 1.0 + 1e-3 * (deviation / max(limit, 1e-12)) ** 8, np.inf)
    _, before = _best_path(cost, 1e-3 * entry, np.add)
    path = [target]
    while before[path[0]] >= 0:
        path.insert(0, int(before[path[0]]))
    largest = max((float(deviation[a, b]) for a, b in pairwise(path)), default=0.0)
    is_beat = any(np.abs(numbers[i]).sum() > 1 for i in path)
    if is_beat and largest * _LEAST_MARGIN > 0.5:
        msg = (
            f"fringes of {_listed(periods)} periods can only be unwrapped by beats that noise "
            f"upsets: a noise of 2 % of the amplitude already makes {largest:.2f} periods of "
            "standard deviation; choose other periods (64, 63, 56 do), more steps, or add a coarse "
            "fringe or a Gray code"
        )
        raise ImageError(msg)
    unused = [i for i in range(len(periods)) if _single(numbers, i) not in path]
    checks = [_single(numbers, i) for i in unused]
    combinations = tuple(tuple(map(int, numbers[i])) for i in [*path, *checks])
    return Ladder(combinations, len(checks), largest)


def _common_period(periods: tuple[float, ...]) -> float:
    """Return the periods over the projector with which all fringes repeat together."""
    shares = [Fraction(count).limit_denominator(10_000) for count in periods]

    def common(a: Fraction, b: Fraction) -> Fraction:
        denominator = math.lcm(a.denominator, b.denominator)
        return Fraction(math.gcd(int(a * denominator), int(b * denominator)), denominator)

    return float(reduce(common, shares))


def _ambiguous(periods: tuple[float, ...], size: int, code_width: int | None) -> str:
    """Return why nothing makes the fringes absolute."""
    repeats = _common_period(periods)
    if code_width is not None:
        coarsest = size / float(_combinations(periods)[1][0])
        return (
            f"the Gray code is {code_width} px wide, more than the {coarsest:g} px over which the "
            f"coarsest fringes are unambiguous; fringes of {_listed(periods)} periods need finer "
            "codes"
        )
    if repeats > 1.0:
        return (
            f"fringes of {_listed(periods)} periods repeat every {size / repeats:g} px of {size}; "
            "add a fringe of one period, another whose beats are unambiguous, or a Gray code"
        )
    return (
        f"no combination of fringes of {_listed(periods)} periods with small whole numbers has one "
        "period or less; choose other periods (64, 63, 56 do), or add a coarse fringe or a Gray "
        "code"
    )


def _listed(periods: tuple[float, ...]) -> str:
    return ", ".join(f"{count:g}" for count in periods)


@lru_cache(maxsize=256)
def _combinations(
    periods: tuple[float, ...],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return k (n, fringes) without common factor, and periods (n,), ascending and positive."""
    n = len(periods)
    largest = _LARGEST_SUMS.get(n, 3)
    numbers = np.array(list(_within(n, largest)), dtype=np.int64)
    frequencies = numbers @ np.array(periods)
    useful = (frequencies > 1e-6) & (np.gcd.reduce(numbers, axis=1) == 1)
    numbers, frequencies = numbers[useful], frequencies[useful]
    sums = np.abs(numbers).sum(axis=1)
    order = np.lexsort([*numbers.T, sums, frequencies])
    return numbers[order], frequencies[order]


def _within(n: int, largest: int) -> list[tuple[int, ...]]:
    """Return the whole-number vectors of length n with Σ|k| up to `largest`."""
    if n == 1:
        return [(k,) for k in range(-largest, largest + 1)]
    return [
        (k, *rest)
        for k in range(-largest, largest + 1)
        for rest in _within(n - 1, largest - abs(k))
    ]


def _single(numbers: NDArray[np.int64], fringe: int) -> int:
    """Return the place of a fringe alone."""
    alone = np.zeros(numbers.shape[1], dtype=np.int64)
    alone[fringe] = 1
    return int(np.flatnonzero((numbers == alone).all(axis=1))[0])


def _deviations(
    numbers: NDArray[np.int64], frequencies: NDArray[np.float64], per_phase: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the standard deviation of each step from row to column, in periods of the latter."""
    weighted = numbers * per_phase
    ratio = frequencies[None, :] / frequencies[:, None]
    squares = (weighted**2).sum(axis=1)
    square = ratio**2 * squares[:, None] - 2.0 * ratio * (weighted @ weighted.T) + squares[None, :]
    deviation = np.sqrt(np.maximum(square, 0.0))
    deviation[ratio <= 1.0 + 1e-9] = np.inf  # from coarse to fine only
    return np.asarray(deviation)


def _best_path(
    step: NDArray[np.float64], entry: NDArray[np.float64], joined: np.ufunc
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return each place's least cost from an entry, joined over its steps, and its predecessor."""
    cost, before = entry.copy(), np.full(entry.size, -1, dtype=np.int64)
    for place in range(entry.size):  # ascending: what comes before is final
        through = joined(cost[place], step[place])
        better = through < cost
        cost[better], before[better] = through[better], place
    return cost, before
