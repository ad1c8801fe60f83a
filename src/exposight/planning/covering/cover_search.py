"""A local search for covers: destroy a part, repair it greedily, drop what is redundant, anneal.

In a second it finds what the exact solver may not find in minutes, and hands it over as a cut-off.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.compiled import njit
from exposight.planning.covering.cover_program import Program

BoolArray: TypeAlias = NDArray[np.bool_]
FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]

_ROUND = 3000
"""Iterations of one annealing; several short ones find more than a long one."""

_SLICE = 250
"""Iterations between two looks at the clock; Ctrl-C takes effect there."""

_HOT, _COLD = 0.01, 0.001
"""First and last temperature, as shares of the objective."""

_BEYOND = 1e300


def search(
    program: Program,
    *,
    rounds: int,
    limit_s: float,
    seed: int = 1,
    enough: Callable[[float], bool] = lambda value: False,
) -> BoolArray | None:
    """Return a cheap cover of all features, or None if none was found.

    A view's least number of captures is not looked at; its most is.

    Parameters
    ----------
    program : Program
    rounds : int
        Annealings, each from the start.
    limit_s : float, s
        The search ends after that time, with the best cover until then.
    seed : int
        Random seed.
    enough : callable
        Returns whether the search may end, given the best objective.

    Returns
    -------
    (c,) ndarray of bool
        The captures that are taken.
    """
    started = time.monotonic()
    layout = _layout(program)
    sizes = np.concatenate(
        [np.ones(program.n_captures), [len(group) for group in program.groups]]
    ).astype(np.int64)
    cost = np.concatenate([program.cost, program.members @ program.cost])
    most = np.iinfo(np.int64).max if program.most is None else program.most
    best: BoolArray | None = None
    best_value = math.inf
    for number in range(rounds):
        taken: BoolArray = np.zeros(len(cost), dtype=np.bool_)
        for done in range(0, _ROUND, _SLICE):
            found, taken, value = _anneal(
                *layout,
                program.view,
                cost,
                sizes,
                program.move,
                most,
                taken,
                (_SLICE, done, _ROUND),
                seed + 1000 * number + done,
            )
            if value < _BEYOND:
                captures = _captures(program, found)
                if program.value(captures) < best_value - 1e-9:
                    best, best_value = captures, program.value(captures)
            if enough(best_value) or time.monotonic() - started > limit_s:
                return best
    return best


def _captures(program: Program, taken: BoolArray) -> BoolArray:
    """Return the captures of columns: those of groups among them, and none that is redundant."""
    c = program.n_captures
    in_groups = np.asarray(program.members.T @ taken[c:].astype(float)) > 0.5
    captures: BoolArray = np.asarray(taken[:c] | in_groups, dtype=np.bool_)
    if in_groups.any():
        for each in np.flatnonzero(captures)[np.argsort(-program.cost[captures], kind="stable")]:
            captures[each] = False
            captures[each] = not program.served(captures).all()
    return captures


def _layout(program: Program) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    by_column, by_feature = program.covers.tocsc(), program.covers.tocsr()
    return tuple(  # type: ignore[return-value]
        np.asarray(each, dtype=np.int64)
        for each in (by_column.indptr, by_column.indices, by_feature.indptr, by_feature.indices)
    )


@njit(nogil=True)
def _uniform(state: NDArray[np.uint64]) -> float:
    """Return a random number from 0 to 1, by SplitMix64 (Steele et al. 2014)."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return float((z ^ (z >> np.uint64(31))) >> np.uint64(11)) / 9007199254740992.0


@njit(nogil=True)
def _take(
    c: int,
    column: IntArray,
    features: IntArray,
    row: IntArray,
    columns: IntArray,
    times: IntArray,
    gain: IntArray,
) -> int:
    """Take a column, and return how many features it serves that were not served before."""
    new = 0
    for a in range(column[c], column[c + 1]):
        f = features[a]
        times[f] += 1
        if times[f] == 1:
            new += 1
            for b in range(row[f], row[f + 1]):
                gain[columns[b]] -= 1
    return new


@njit(nogil=True)
def _leave(
    c: int,
    column: IntArray,
    features: IntArray,
    row: IntArray,
    columns: IntArray,
    times: IntArray,
    gain: IntArray,
) -> int:
    """Leave a column out again, and return how many features nothing serves then."""
    lost = 0
    for a in range(column[c], column[c + 1]):
        f = features[a]
        times[f] -= 1
        if times[f] == 0:
            lost += 1
            for b in range(row[f], row[f + 1]):
                gain[columns[b]] += 1
    return lost


@njit(nogil=True)
def _anneal(
    column: IntArray,
    features: IntArray,
    row: IntArray,
    columns: IntArray,
    view: IntArray,
    cost: FloatArray,
    sizes: IntArray,
    move: FloatArray,
    most: int,
    start: BoolArray,
    schedule: tuple[int, int, int],
    seed: int,
) -> tuple[BoolArray, BoolArray, float]:
    """Return the best cover of some iterations, the current one, and the best one's objective.

    gain[c] is the number of features that column c would add, times[f] how often f is served.
    """
    random = np.array([seed], np.uint64)
    iterations, done, total = schedule
    n_columns, n, n_views = len(cost), len(row) - 1, len(move)
    x = np.zeros(n_columns, np.bool_)
    times = np.zeros(n, np.int64)
    gain = column[1:] - column[:-1]
    used = np.zeros(n_views, np.int64)
    value, open_features = 0.0, n
    for c in range(n_columns):
        if start[c]:
            x[c] = True
            open_features -= _take(c, column, features, row, columns, times, gain)
            value += cost[c] + (move[view[c]] if used[view[c]] == 0 else 0.0)
            used[view[c]] += sizes[c]
    best, current = x.copy(), x.copy()
    best_value = current_value = value if open_features == 0 else 1e300
    order = np.empty(n_columns, np.int64)
    key = np.empty(n_columns)
    hit = np.zeros(n_views, np.bool_)
    for iteration in range(iterations):
        heat = _HOT * (_COLD / _HOT) ** ((done + iteration) / total)
        # Destroy: a view; views that see one feature; or captures here and there.
        n_taken = 0
        for c in range(n_columns):
            if x[c]:
                order[n_taken] = c
                n_taken += 1
        hit[:] = False
        kind, share, avoided = _uniform(random), 0.0, -1
        if n_taken > 0 and kind < 0.3:
            v = view[order[int(_uniform(random) * n_taken)]]
            hit[v] = True
            if _uniform(random) < 0.7:
                avoided = v
        elif n_taken > 0 and kind < 0.8:
            f = int(_uniform(random) * n)
            all_of_them = _uniform(random) < 0.5
            for b in range(row[f], row[f + 1]):
                hit[view[columns[b]]] = True
            if not all_of_them:
                for v in range(n_views):
                    hit[v] = hit[v] and _uniform(random) < 0.6
        else:
            share = 0.05 + 0.2 * _uniform(random)
        for k in range(n_taken):
            c = order[k]
            if hit[view[c]] or (share > 0.0 and _uniform(random) < share):
                x[c] = False
                open_features += _leave(c, column, features, row, columns, times, gain)
                used[view[c]] -= sizes[c]
                value -= cost[c] + (move[view[c]] if used[view[c]] == 0 else 0.0)
        # Repair: most new features for the cost, with some chance.
        noise = 0.5 * _uniform(random)
        while open_features > 0:
            chosen, score = -1, 0.0
            for c in range(n_columns):
                v = view[c]
                if gain[c] > 0 and not x[c] and used[v] + sizes[c] <= most:
                    price = cost[c] + (move[v] if used[v] == 0 else 0.0)
                    if v == avoided:
                        price *= 3.0
                    s = gain[c] / price * (1.0 + noise * _uniform(random))
                    if s > score:
                        chosen, score = c, s
            if chosen < 0:
                break  # a view's most captures are in the way
            x[chosen] = True
            open_features -= _take(chosen, column, features, row, columns, times, gain)
            value += cost[chosen] + (move[view[chosen]] if used[view[chosen]] == 0 else 0.0)
            used[view[chosen]] += sizes[chosen]
        # Drop what is redundant, the dear ones first.
        n_taken = 0
        for c in range(n_columns):
            if x[c]:
                order[n_taken] = c
                last = used[view[c]] == sizes[c]
                price = cost[c] + (move[view[c]] if last else 0.0)
                key[n_taken] = -price * (1.0 + 0.3 * _uniform(random))
                n_taken += 1
        sequence = np.argsort(key[:n_taken])
        for k in range(n_taken):
            c = order[sequence[k]]
            needed = False
            for a in range(column[c], column[c + 1]):
                if times[features[a]] < 2:
                    needed = True
                    break
            if not needed:
                x[c] = False
                _leave(c, column, features, row, columns, times, gain)
                used[view[c]] -= sizes[c]
                value -= cost[c] + (move[view[c]] if used[view[c]] == 0 else 0.0)
        # Exchange captures for cheaper ones of their view that serve what only they serve.
        if open_features == 0 and value < 1.02 * current_value:
            for k in range(n_taken):
                c = order[k]
                if not x[c]:
                    continue
                lost = _leave(c, column, features, row, columns, times, gain)
                chosen = c
                f = features[column[c]]
                for a in range(column[c], column[c + 1]):
                    if times[features[a]] == 0:
                        f = features[a]
                        break
                for b in range(row[f], row[f + 1]):
                    d = columns[b]
                    if (
                        view[d] == view[c]
                        and gain[d] == lost
                        and cost[d] < cost[chosen]
                        and sizes[d] <= sizes[c]
                        and not x[d]
                    ):
                        chosen = d
                _take(chosen, column, features, row, columns, times, gain)
                if chosen != c:
                    x[c], x[chosen] = False, True
                    value += cost[chosen] - cost[c]
                    used[view[c]] += sizes[chosen] - sizes[c]
        worse = value - current_value
        if open_features == 0 and (
            worse <= 0.0 or _uniform(random) < math.exp(-worse / (heat * best_value))
        ):
            current_value = value
            current[:] = x
            if value < best_value - 1e-9:
                best_value = value
                best[:] = x
            continue
        for c in range(n_columns):
            if x[c] and not current[c]:
                x[c] = False
                open_features += _leave(c, column, features, row, columns, times, gain)
                used[view[c]] -= sizes[c]
        for c in range(n_columns):
            if current[c] and not x[c]:
                x[c] = True
                open_features -= _take(c, column, features, row, columns, times, gain)
                used[view[c]] += sizes[c]
        value = current_value if open_features == 0 else _sum_of(x, cost, view, move)
    return best, current, best_value


@njit(nogil=True)
def _sum_of(x: BoolArray, cost: FloatArray, view: IntArray, move: FloatArray) -> float:
    """Return the cost of columns and of their views."""
    visited = np.zeros(len(move), np.bool_)
    value = 0.0
    for c in range(len(x)):
        if x[c]:
            value += cost[c]
            visited[view[c]] = True
    for v in range(len(move)):
        if visited[v]:
            value += move[v]
    return value
