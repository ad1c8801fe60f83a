"""What may be asked of a plan; and a wish for few misses in all, which no program has."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

from exposight.errors import InputError
from exposight.planning.exposure_plan import ExposurePlan
from exposight.tables import number

PlanAt: TypeAlias = Callable[[float, float], ExposurePlan]

_LEAST_MS = 1e-3
"""No capture is shorter."""

_TRIES = 6
"""Lower confidences that are tried for a wish of expected misses."""

_DUST = 1e-9


def check_goal(goal: str, budget: float | None, time_limit_s: float) -> None:
    """Check what is asked of a plan.

    Raises
    ------
    InputError
        If the goal is unknown, or the budget or the time limit allows nothing.
    """
    if goal not in ("count", "time"):
        msg = f"goal must be 'count' or 'time', got {goal!r}"
        raise InputError(msg)
    if budget is not None:
        if goal == "time" and not budget >= _LEAST_MS:
            msg = (
                f"a budget of time is {number(_LEAST_MS)} ms or more, got {number(budget)} ms; "
                "leave it out to plan without one"
            )
            raise InputError(msg)
        if goal == "count" and not (budget >= 1.0 and float(budget).is_integer()):
            msg = (
                f"a budget is a whole number of captures, at least one, got {budget:g}; "
                "leave it out to plan without one"
            )
            raise InputError(msg)
    if not time_limit_s > 0.0:
        msg = f"the time limit must be above 0 s, got {time_limit_s:g}"
        raise InputError(msg)


def check_misses(expected_misses: float, n: int) -> None:
    """Check how many of n features may be expected to fail.

    Raises
    ------
    InputError
        If that is none, or all.
    """
    if not 0.0 < expected_misses < n:
        msg = (
            f"expected misses are a number above 0 and below that of the features, {n}, got "
            f"{expected_misses:g}"
        )
        raise InputError(msg)


def least_for_misses(
    plan_at: PlanAt, expected_misses: float, n: int, time_limit_s: float
) -> ExposurePlan:
    """Return a plan of which at most so many of n features are to be expected to fail.

    With 1 − expected_misses / n for each feature that is kept, if each can be had; but features
    have more than is asked, and so a lower confidence may keep it as well, with fewer captures. It
    is looked for by bisection; a plan that uneven confidences allow is not.

    Parameters
    ----------
    plan_at : callable
        Plans with a confidence for each feature, within a time limit in s.
    expected_misses : float
        Above 0 and below n.
    n : int
        Number of features.
    time_limit_s : float, s
        By the wall clock, for all plans together.
    """
    started = time.monotonic()
    miss = expected_misses / n
    best = replace(plan_at(1.0 - miss, time_limit_s), expected_misses=expected_misses)
    most = min(expected_misses, 0.5)
    if best.budget is not None or best.misses > expected_misses + _DUST:
        return best
    for _ in range(_TRIES):
        left_s = time_limit_s - (time.monotonic() - started)
        middle = (miss * most) ** 0.5
        if left_s <= 0.0 or middle < 1.01 * miss or best.n_captures <= 1:
            break
        plan = replace(plan_at(1.0 - middle, left_s), expected_misses=expected_misses)
        if plan.misses > expected_misses + _DUST:
            most = middle
            continue
        miss = middle
        by = "time_ms" if plan.goal == "time" else "n_captures"
        if getattr(plan, by) < getattr(best, by):
            best = plan
    return best
