"""How many features can be had for how many captures, or how much time: a curve with bounds."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from itertools import zip_longest
from typing import TypeAlias

import numpy as np

from exposight.planning.capture_chances import CaptureChances
from exposight.planning.covering.cover_budget import Choice, greedy_choices, most_within
from exposight.planning.covering.cover_demand import Demand, demand_of
from exposight.planning.covering.cover_solver import cheapest_cover
from exposight.planning.covering.cover_wishes import check_goal
from exposight.planning.exposure_limits import CaptureCosts, ExposureLimits
from exposight.planning.exposure_plan import ExposurePlan, Goal
from exposight.planning.recommendation import CONFIDENCE, check_confidence
from exposight.tables import Column, Table
from exposight.workers import Progress, ignore_progress

Places: TypeAlias = list[tuple[int, ...]]

_DUST = 1e-9

_AT_ONCE = 4
"""So many points at most share the time that is left; later ones are bounded by earlier ones."""

_EXACT = 3000
"""Features times views up to which each point of the curve is solved exactly."""


def _columns(by_time: bool) -> tuple[Column, ...]:
    return (
        Column(name="captures"),
        Column(name="views"),
        Column(name="time_s", label="time\ns", digits=3),
        Column(name="features", label="features at\nthe confidence"),
        Column(
            name="bound",
            label=f"at most, {'in that time' if by_time else 'with so many'}".replace(", ", ",\n"),
            decimals=0,
        ),
        Column(name="expected", label="expected\nfeatures", decimals=1),
    )


def trade_off(
    views: Sequence[CaptureChances],
    limits: ExposureLimits,
    costs: CaptureCosts | None = None,
    *,
    goal: Goal = "count",
    confidence: float = CONFIDENCE,
    moves: bool = True,
    points: int = 10,
    plan: ExposurePlan | None = None,
    time_limit_s: float = 20.0,
    seed: int = 1,
    progress: Progress = ignore_progress,
) -> Table:
    """Return how many features can be had for how many captures, or how much time.

    Parameters
    ----------
    views, limits, costs, goal, confidence, moves, seed, progress
        As for `plan_exposures`.
    points : int
        Points of the curve, at most; the last one serves all that can be served.
    plan : ExposurePlan, optional
        A plan that is a point of its own, in place of those that it is no worse than.
    time_limit_s : float, s
        By the wall clock, for all points together.

    Returns
    -------
    Table
        A row for each budget: ``captures``, ``views``, ``time_s``, ``features`` that reach the
        confidence, at most ``bound`` within this budget, and ``expected`` features.

    Raises
    ------
    InputError
        As `plan_exposures`.
    """
    costs, started = costs or CaptureCosts(), time.monotonic()
    check_goal(goal, None, time_limit_s)
    by_time = goal == "time"
    demand = demand_of(
        views,
        limits,
        costs,
        by_time=by_time,
        confidence=check_confidence(confidence),
        moves=moves,
    )
    program = demand.program
    cover = cheapest_cover(program, limit_s=0.5 * time_limit_s, seed=seed, progress=progress)
    seeds = () if cover is None else (cover.taken,)
    worth = (demand.targets[demand.asked] >= confidence - _DUST).astype(float)
    steps = greedy_choices(program, worth, among=seeds[0] if seeds else None)[1:]
    budgets = sorted({program.value(taken) for taken in steps})
    chosen = np.unique(np.linspace(0, len(budgets) - 1, points).round().astype(int)).tolist()
    wanted = [budgets[place] for place in chosen] if budgets else []
    choices: dict[float, Choice] = {}
    for done, budget in enumerate(_spread(wanted)):
        progress("the trade-off", done, len(wanted))
        left = max(time_limit_s - (time.monotonic() - started), 0.05)
        choices[budget] = most_within(
            program,
            worth,
            budget,
            limit_s=left / min(len(wanted) - done, _AT_ONCE),
            seeds=seeds,
            exact=len(demand.asked) * len(views) < _EXACT,
        )
    progress("the trade-off", len(wanted), len(wanted))
    tangents = [each.tangent for each in choices.values() if each.tangent is not None]

    def at_most(budget: float) -> float:
        bounds = [each.bound for at, each in choices.items() if at >= budget - _DUST]
        lines = [top + slope * (budget - at) for at, top, slope in tangents]
        return float(math.floor(min([worth.sum(), *bounds, *lines]) + 1e-6))

    rows = [
        _point(demand, demand.places(choices[budget].taken), costs, moves, confidence)
        | {"bound": at_most(budget)}
        for budget in wanted
    ]
    cost = "time_s" if by_time else "captures"
    if plan is not None and plan.views:
        planned = _planned_point(plan)
        planned["bound"] = at_most(plan.time_ms if by_time else float(plan.n_captures))
        rows = [
            row
            for row in rows
            if row[cost] < planned[cost] - _DUST or row["features"] > planned["features"]
        ]
        rows = sorted([*rows, planned], key=lambda row: (row[cost], row["features"]))
    for row in rows:
        row["bound"] = max(row["bound"], row["features"])
    return Table.of("trade_off", rows, _columns(by_time), title="Features over captures and time")


def _spread(budgets: Sequence[float]) -> list[float]:
    """Return budgets in an order in which the first few stand for all: middles of what is left."""
    if len(budgets) < 2:
        return list(budgets)
    middle = len(budgets) // 2
    halves = zip_longest(_spread(budgets[:middle]), _spread(budgets[middle + 1 :]))
    return [budgets[middle], *(each for pair in halves for each in pair if each is not None)]


def _point(
    demand: Demand, places: Places, costs: CaptureCosts, moves: bool, confidence: float
) -> dict[str, float]:
    chance = dict.fromkeys(demand.features, 0.0)
    time_ms, visited = 0.0, [v for v, chosen in enumerate(places) if chosen]
    for v in visited:
        view = demand.views[v]
        time_ms += sum(costs.capture_ms(float(view.settings_ms[i])) for i in places[v])
        time_ms += costs.move_ms if moves else 0.0
        for name, each in zip(view.features, view.any_of(places[v]).tolist(), strict=True):
            chance[name] = max(chance[name], each)
    return {
        "captures": sum(map(len, places)),
        "views": len(visited),
        "time_s": time_ms / 1000.0,
        "features": sum(each >= confidence - _DUST for each in chance.values()),
        "bound": 0.0,
        "expected": sum(chance.values()),
    }


def _planned_point(plan: ExposurePlan) -> dict[str, float]:
    return {
        "captures": plan.n_captures,
        "views": len(plan.views),
        "time_s": plan.time_ms / 1000.0,
        "features": len(plan.with_status("planned")),
        "bound": 0.0,
        "expected": sum(each.chance for each in plan.features),
    }
