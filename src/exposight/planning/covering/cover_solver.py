"""Solve cover programs to a proven optimum, or to the best cover and its gap when time runs out.

Three steps share the work: the relaxation gives a bound and says which captures no cheap cover
takes; a local search gives a cover; the integer program, told to find a cheaper one or prove that
there is none, closes the gap. Objectives, feasibility and gaps are computed here from the captures
themselves; no solver is believed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from concurrent.futures import TimeoutError as NotYetError
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.planning.covering.cover_program import Linear, Program
from exposight.planning.covering.cover_search import search
from exposight.planning.covering.highs_process import HighsProcess, solve_arrays
from exposight.workers import Progress, ignore_progress

BoolArray: TypeAlias = NDArray[np.bool_]
FloatArray: TypeAlias = NDArray[np.float64]

_GAP = 1e-4
"""A cover this share above its bound counts as optimal, where costs are times."""

_SMALL = 20000
"""Entries of a matrix up to which a program is solved here, as a process would take longer."""

_HERE_S = 1.0
"""For so long at most: Ctrl-C waits for it."""

_ROUNDS, _ENDLESS = 8, 10**6
"""Annealings of the local search, before the exact solver and while it works."""

_PATIENCE_S = 3.0
"""HiGHS looks at the clock between its steps; one that is later than this is not waited for."""

_SEARCH_SHARE = 0.25
"""Share of the time limit that the local search may take."""

_DUST = 1e-6
"""Sums of floating-point numbers differ by less, relative to them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Cover:
    """Captures that serve all features, and what is known of cheaper ones.

    Parameters
    ----------
    taken : (c,) ndarray of bool
        The captures.
    objective, lower_bound : float
        Their cost, and what every cover costs at least.
    """

    taken: BoolArray
    objective: float
    lower_bound: float

    @property
    def gap(self) -> float:
        """Share of the objective by which a cheaper cover could undercut it."""
        return (
            max(self.objective - self.lower_bound, 0.0) / self.objective if self.objective else 0.0
        )


class Deadline:
    """A time limit on the wall clock."""

    def __init__(self, limit_s: float) -> None:
        self._start = time.monotonic()
        self._limit_s = limit_s

    @property
    def left_s(self) -> float:
        """Seconds that are left, none below 0."""
        return max(self._limit_s - self.spent_s, 0.0)

    @property
    def overdue_s(self) -> float:
        """Seconds since the limit, none below 0."""
        return max(self.spent_s - self._limit_s, 0.0)

    @property
    def spent_s(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self._start


def cheapest_cover(
    program: Program,
    *,
    limit_s: float = 20.0,
    seed: int = 1,
    incumbent: bool = True,
    progress: Progress = ignore_progress,
) -> Cover | None:
    """Return the cheapest cover of all features, or the best one found in time.

    Parameters
    ----------
    program : Program
        Each feature can be served.
    limit_s : float, s
        Time limit by the wall clock.
    seed : int
        Random seed of the local search.
    incumbent : bool
        Whether the local search is used; without it, HiGHS alone (for comparison).
    progress : Progress

    Returns
    -------
    Cover or None
        None if a view's most captures leave no cover of all features.
    """
    deadline = Deadline(limit_s)
    taken = np.zeros(program.n_captures, dtype=np.bool_)
    bound, done = 0.0, 0
    n = program.covers.shape[0]
    for features, captures in program.components():
        share = len(features) / max(n - done, 1)
        part = program.part(features, captures)
        cover = _cheapest(part, deadline.left_s * share, seed, incumbent, progress)
        if cover is None:
            return None
        taken[captures] = cover.taken
        bound += cover.lower_bound
        done += len(features)
    return Cover(taken=taken, objective=program.value(taken), lower_bound=bound)


def _cheapest(
    program: Program, limit_s: float, seed: int, incumbent: bool, progress: Progress
) -> Cover | None:
    """Return the cheapest cover of one component."""
    deadline = Deadline(limit_s)
    program = program.without_implied()
    counts = bool((program.cost == 1.0).all() and not program.move.any())

    def searched(
        rounds: int, limit_s: float, seed: int, enough: Callable[[float], bool]
    ) -> BoolArray | None:
        found = search(program, rounds=rounds, limit_s=limit_s, seed=seed, enough=enough)
        return None if found is None else filled_up(program, found)

    with Solver(program.linear(), deadline, progress) as solver:
        relaxed = solver.start(relaxed=True)
        taken = None
        if incumbent:
            taken = searched(
                _ROUNDS,
                _SEARCH_SHARE * limit_s,
                seed,
                lambda value: (
                    relaxed.done() and value <= _rounded(relaxed.result()["bound"], counts) + 1e-9
                ),
            )
        answer = solver.result(relaxed)
        if answer["bound"] == math.inf:
            return None
        bound = max(0.0, _rounded(answer["bound"], counts))
        value = math.inf if taken is None else program.value(taken)
        slack, dust = (0.0, 0.0) if taken is None else (_GAP * value, _DUST * value)
        slack = 1.0 if counts else slack
        if taken is not None and value - bound < slack - dust:
            return Cover(taken=taken, objective=value, lower_bound=min(bound, value))
        cutoff = value - slack + (dust if counts else 0.0)
        whole = solver.start(relaxed=False, cutoff=cutoff, without=_too_dear(answer, cutoff))
        covers = [] if taken is None else [taken]
        if incumbent and not whole.done():  # this process has nothing else to do meanwhile
            more = searched(_ENDLESS, deadline.left_s, seed + 1, lambda value: whole.done())
            covers += [] if more is None else [more]
        answer = solver.result(whole)
    # What costs more than the cut-off was not looked at: the bound is no higher.
    bound = max(bound, min(_rounded(answer["bound"], counts), value if counts else cutoff))
    if len(answer["x"]):
        covers.append(answer["x"][: program.n_captures] > 0.5)
    right = [each for each in covers if program.served(each).all() and program.keeps_limits(each)]
    if not right:
        return None
    taken = min(right, key=program.value)
    value = program.value(taken)
    return Cover(taken=taken, objective=value, lower_bound=min(bound, value))


def _too_dear(relaxed: Mapping[str, Any], cutoff: float) -> BoolArray | None:
    """Return which variables are 0 in all solutions up to a cut-off, by their reduced costs."""
    if not len(relaxed["reduced"]) or cutoff == math.inf:
        return None
    out: BoolArray = relaxed["bound"] + relaxed["reduced"] > cutoff
    return out


def _rounded(bound: float, counts: bool) -> float:
    """Return a bound; a number of captures is whole."""
    return float(math.ceil(bound - 1e-6)) if counts and math.isfinite(bound) else bound


def filled_up(program: Program, taken: BoolArray) -> BoolArray:
    """Add the cheapest captures to views that take fewer than their least number."""
    filled = taken.copy()
    for view in np.flatnonzero((counts := program.counts(taken)) > 0):
        others = np.flatnonzero((program.view[: program.n_captures] == view) & ~taken)
        cheapest = others[np.argsort(program.cost[others], kind="stable")]
        filled[cheapest[: max(program.least - counts[view], 0)]] = True
    return filled


class Solver:
    """Solves forms of one linear program: here where it is small, else in another process.

    Use it in a ``with`` block, which ends that process also after Ctrl-C.
    """

    def __init__(self, linear: Linear, deadline: Deadline, progress: Progress) -> None:
        self._linear, self._deadline, self._progress = linear, deadline, progress
        self._process = None if linear.matrix.nnz <= _SMALL else HighsProcess()

    def __enter__(self) -> Solver:
        return self

    def __exit__(self, *error: object) -> None:
        if self._process is not None:
            self._process.close()

    def start(
        self, *, relaxed: bool, cutoff: float = math.inf, without: BoolArray | None = None
    ) -> Future[dict[str, Any]]:
        """Begin to solve the program.

        Parameters
        ----------
        relaxed : bool
            Whether numbers need not be whole.
        cutoff : float
            Dearer solutions are not looked for.
        without : ndarray of bool, optional
            Variables that are 0.
        """
        linear = self._linear if cutoff == math.inf else self._linear.at_most(cutoff)
        request = {
            "objective": linear.objective,
            "data": linear.matrix.data,
            "indices": linear.matrix.indices,
            "indptr": linear.matrix.indptr,
            "low": linear.low,
            "upper": linear.upper if without is None else np.where(without, 0.0, linear.upper),
            "whole": linear.whole,
            "relaxed": relaxed,
            "gap": _GAP,
            "limit_s": self._deadline.left_s,
        }
        if self._process is None:
            answer = solve_arrays({**request, "limit_s": min(self._deadline.left_s, _HERE_S)})
            if answer["finished"] or self._deadline.left_s < _HERE_S:
                answered: Future[dict[str, Any]] = Future()
                answered.set_result(answer)
                return answered
            self._process = HighsProcess()
        return self._process.start({**request, "limit_s": self._deadline.left_s})

    def result(self, future: Future[dict[str, Any]]) -> dict[str, Any]:
        """Wait for an answer; one that is long overdue is not waited for."""
        while True:
            spent, left = self._deadline.spent_s, self._deadline.left_s
            self._progress("planning", int(spent), max(math.ceil(spent + left), 1))
            try:
                return future.result(timeout=0.25)
            except NotYetError:
                if self._deadline.overdue_s > _PATIENCE_S:
                    none = np.zeros(0)
                    return {"bound": -math.inf, "x": none, "finished": False, "reduced": none}
