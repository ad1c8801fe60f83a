"""Most features within a budget, and features over cost as a curve, each with its bound."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.planning.covering.cover_program import Program
from exposight.planning.covering.cover_solver import Deadline, Solver, filled_up
from exposight.workers import Progress, ignore_progress

BoolArray: TypeAlias = NDArray[np.bool_]
FloatArray: TypeAlias = NDArray[np.float64]

_DUST = 1e-9

_GAP = 1e-4
"""Share of the worth by which a better choice is not looked for."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """Captures within a budget.

    Parameters
    ----------
    taken : (c,) ndarray of bool
        The captures.
    worth, bound : float
        What the features are worth that they serve, and what no choice within the budget exceeds.
    tangent : (float, float, float) or None
        A budget, the relaxation's worth there and its slope: as that worth is concave over the
        budget, this line bounds what any other budget gives, too.
    """

    taken: BoolArray
    worth: float
    bound: float
    tangent: tuple[float, float, float] | None = None


def greedy_choices(
    program: Program,
    weights: FloatArray,
    *,
    budget: float = math.inf,
    among: BoolArray | None = None,
) -> list[BoolArray]:
    """Take what adds most for its cost, again and again, as long as it fits a budget.

    Parameters
    ----------
    program : Program
    weights : (n,) ndarray
        What each feature is worth.
    budget : float
        What all may cost.
    among : (c,) ndarray of bool, optional
        The captures to choose from.

    Returns
    -------
    list of (c,) ndarray of bool
        The captures after each step, none before the first.
    """
    c, covers = program.n_captures, program.covers
    left = np.ones(c, dtype=np.bool_) if among is None else among
    complete = np.asarray(program.members @ (~left).astype(float)) == 0.0
    usable = np.concatenate([left, complete])
    taken = np.zeros(c, dtype=np.bool_)
    most = math.inf if program.most is None else program.most
    out: list[BoolArray] = [taken.copy()]
    spent, open_weight = 0.0, np.array(weights, dtype=np.float64)
    while True:
        counts = program.counts(taken)
        new = np.concatenate([~taken, np.asarray(program.members @ (~taken).astype(float))])
        price = np.where(taken, 0.0, program.cost)
        price = np.concatenate([price, program.members @ price])
        price += np.where(counts == 0, program.move, 0.0)[program.view]
        gain = np.asarray(covers.T @ open_weight)
        gain[c:] += program.members @ np.where(taken, 0.0, gain[:c])
        fits = usable & (gain > 0.0) & (new > 0.0) & (counts[program.view] + new <= most)
        fits &= spent + price <= budget + _DUST
        if not fits.any():
            return out
        with np.errstate(divide="ignore", invalid="ignore"):
            chosen = int(np.argmax(np.where(fits, gain / price, -1.0)))
        members = [chosen] if chosen < c else list(program.groups[chosen - c])
        taken[members] = True
        spent = program.value(taken)
        open_weight[program.served(taken)] = 0.0
        out.append(taken.copy())


def most_within(
    program: Program,
    weights: FloatArray,
    budget: float,
    *,
    limit_s: float = 20.0,
    seeds: tuple[BoolArray, ...] = (),
    exact: bool = True,
    progress: Progress = ignore_progress,
) -> Choice:
    """Return the captures within a budget whose features are worth most.

    Parameters
    ----------
    program : Program
    weights : (n,) ndarray
        What each feature is worth.
    budget : float
        What captures and views may cost; may be infinite where a view's most captures limit them.
    limit_s : float, s
        Time limit by the wall clock.
    seeds : tuple of (c,) ndarray of bool
        Good covers, parts of which may be good choices.
    exact : bool
        Whether the integer program is solved after the greedy choice and its bound.
    progress : Progress
    """
    deadline = Deadline(limit_s)
    steps = [
        filled_up(program, taken)
        for among in (None, *seeds)
        for taken in greedy_choices(program, weights, budget=budget, among=among)
    ]
    choices = [
        each
        for each in steps
        if program.value(each) <= budget + _DUST and program.keeps_limits(each)
    ]

    def worth(taken: BoolArray) -> float:
        return float(weights[program.served(taken)].sum())

    best = max(choices, key=worth)  # nothing at all is a choice, too
    total, whole = float(weights.sum()), bool(np.isin(weights, (0.0, 1.0)).all())
    if worth(best) >= total - _DUST:
        return Choice(taken=best, worth=worth(best), bound=total)
    room = min(budget, program.value(np.ones(program.n_captures, dtype=np.bool_)))
    with Solver(program.linear(weights, room), deadline, progress) as solver:
        relaxed = solver.result(solver.start(relaxed=True))
        tangent = None
        if relaxed["finished"] and "price" in relaxed:
            tangent = (room, -relaxed["bound"], -float(relaxed["price"]))
        bound = min(total, _rounded(-relaxed["bound"], whole))
        slack = 1.0 if whole else _GAP * worth(best)
        if exact and bound - worth(best) >= slack - _DUST and deadline.left_s > 0.0:
            cutoff = -(worth(best) + slack) + 1e-6
            answer = solver.result(solver.start(relaxed=False, cutoff=cutoff))
            below = worth(best) if whole else worth(best) + slack
            bound = min(bound, max(_rounded(-answer["bound"], whole), below))
            if len(answer["x"]):
                found = answer["x"][: program.n_captures] > 0.5
                right = program.value(found) <= budget + 1e-6 and program.keeps_limits(found)
                if right and worth(found) > worth(best):
                    best = found
    bound = max(bound, worth(best))
    return Choice(taken=best, worth=worth(best), bound=bound, tangent=tangent)


def _rounded(bound: float, whole: bool) -> float:
    return float(math.floor(bound + 1e-6)) if whole and math.isfinite(bound) else bound
