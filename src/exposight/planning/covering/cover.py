"""Plan the exposures of many views: fewest captures, least time, or most features in a budget."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from exposight.geometry import RigidTransform
from exposight.planning.capture_chances import CaptureChances
from exposight.planning.covering.cover_budget import most_within
from exposight.planning.covering.cover_demand import Demand, demand_of
from exposight.planning.covering.cover_solver import cheapest_cover
from exposight.planning.covering.cover_wishes import check_goal, check_misses, least_for_misses
from exposight.planning.covering.visiting_order import visiting_order
from exposight.planning.exposure_limits import CaptureCosts, ExposureLimits
from exposight.planning.exposure_plan import (
    Certificate,
    ExposurePlan,
    Goal,
    ModelReference,
    PlanView,
    Promise,
)
from exposight.planning.outlook import (
    WORTH_TRYING,
    FeatureOutlook,
    outlook_of,
    planned_exposures,
)
from exposight.planning.path_search import Path, Prefer, cheapest_captures
from exposight.planning.recommendation import CONFIDENCE, check_confidence, chosen_path
from exposight.workers import Progress, ignore_progress

FloatArray: TypeAlias = NDArray[np.float64]
Places: TypeAlias = list[tuple[int, ...]]

_DUST = 1e-9

_PROVEN = 2e-4
"""A gap below this counts as none, where costs are times."""

_CORRELATION = (
    "exposures of one view: exact joint chances; several views of a feature: the best view alone, "
    "which is a lower bound; chance of all: a lower bound whatever the features' dependence"
)


def plan_exposures(
    views: Sequence[CaptureChances],
    limits: ExposureLimits,
    costs: CaptureCosts | None = None,
    *,
    goal: Goal = "count",
    confidence: float = CONFIDENCE,
    expected_misses: float | None = None,
    budget: float | None = None,
    prefer: Prefer = "margin",
    moves: bool = True,
    poses: Mapping[str, RigidTransform] | None = None,
    not_seen: Mapping[str, str] | None = None,
    sensor: str = "",
    part: str = "",
    models: Sequence[ModelReference] = (),
    remarks: Sequence[str] = (),
    time_limit_s: float = 20.0,
    seed: int = 1,
    progress: Progress = ignore_progress,
) -> ExposurePlan:
    """Plan which exposures to take in which views.

    Every feature that can be brought to the confidence is, by one capture or by several of one
    view; others are served as well as may be, and named with the reason. The plan is proven best or
    comes with a bound of all others; when time runs out the best one until then is returned.

    Parameters
    ----------
    views : sequence of CaptureChances
        What captures of each view promise, at settings of the sensor.
    limits : ExposureLimits
        What the sensor can be set to; settings that it does not allow are not planned.
    costs : CaptureCosts, optional
        What captures and moves take; exposure time alone by default.
    goal : {"count", "time"}
        Fewest captures, or least time.
    confidence : float
        Chance that each feature shall have.
    expected_misses : float, optional
        Of n features at most so many shall be expected to fail, in place of the confidence:
        1 − expected_misses / n is enough (Bonferroni), and lower ones are tried, too, where that
        keeps it (`least_for_misses`); not within a budget.
    budget : float, optional
        Serve most features with at most so many captures or, with the goal time, milliseconds.
    prefer : {"margin", "time"}
        Among the fewest captures: those with most margin, or those that take least.
    moves : bool
        Whether each view that is visited costs a move; not where a robot's program is fixed.
    poses : mapping of str to RigidTransform, optional
        camera_from_part of views. With moves, views are visited on short ways.
    not_seen : mapping of str to str, optional
        Features that no view sees, and why.
    sensor, part : str
        Names.
    models : sequence of ModelReference
        What predicted the chances.
    remarks : sequence of str
        What is odd about all of it.
    time_limit_s : float, s
        By the wall clock.
    seed : int
        Random seed of the local search.
    progress : Progress

    Raises
    ------
    InputError
        If the confidence is not between 0 and 1, the budget is not above 0, no view sees a feature,
        or a name is there twice.
    """
    costs, started = costs or CaptureCosts(), time.monotonic()
    check_confidence(confidence)
    check_goal(goal, budget, time_limit_s)
    if expected_misses is not None:

        def plan_at(confidence: float, limit_s: float) -> ExposurePlan:
            return plan_exposures(
                views,
                limits,
                costs,
                goal=goal,
                confidence=confidence,
                budget=budget,
                prefer=prefer,
                moves=moves,
                poses=poses,
                not_seen=not_seen,
                sensor=sensor,
                part=part,
                models=models,
                remarks=remarks,
                time_limit_s=limit_s,
                seed=seed,
                progress=progress,
            )

        n = len({name for view in views for name in view.features})
        check_misses(expected_misses, n)
        return least_for_misses(plan_at, expected_misses, n, time_limit_s)
    by_time = goal == "time"
    demand = demand_of(views, limits, costs, by_time=by_time, confidence=confidence, moves=moves)
    answer = _solve(demand, budget, time_limit_s, seed, progress)
    places = [
        _better_settings(demand, v, answer.places, limits, costs, None if by_time else prefer)
        for v in range(len(views))
    ]
    costs = costs if moves else replace(costs, move_ms=0.0)
    visited = [v for v, chosen in enumerate(places) if chosen]
    poses = dict(poses or {})
    if moves and visited and all(views[v].view in poses for v in visited):
        order = visiting_order({views[v].view: poses[views[v].view] for v in visited})
        visited.sort(key=lambda v: order.index(views[v].view))
    features = _outlook(demand, places, confidence, limits, budget)
    features += tuple(
        FeatureOutlook(feature=name, status="not planned", chance=0.0, reason=f"not seen, {why}")
        for name, why in (not_seen or {}).items()
        if name not in demand.features
    )
    plan = ExposurePlan(
        sensor=sensor or limits.name,
        part=part,
        target_p_norm=views[0].need,
        confidence=confidence,
        goal=goal,
        prefer=prefer,
        budget=budget,
        limits=limits,
        costs=costs,
        views=tuple(
            PlanView(
                name=views[v].view,
                camera_from_part=poses.get(views[v].view),
                exposures=planned_exposures(views[v], places[v], limits),
            )
            for v in visited
        ),
        features=features,
        promise=_promise(features),
        certificate=answer.certificate,
        models=tuple(models),
        remarks=tuple(remarks),
    )
    return replace(plan, certificate=_certificate(plan, answer, time.monotonic() - started))


@dataclass(frozen=True, kw_only=True)
class _Answer:
    """Settings of each view, and the certificate of the program that they were chosen by."""

    places: Places
    certificate: Certificate


def _solve(
    demand: Demand, budget: float | None, limit_s: float, seed: int, progress: Progress
) -> _Answer:
    """Solve the program; where limits forbid to serve all features, for most of them."""
    program = demand.program
    started = time.monotonic()
    if not len(demand.asked):
        certificate = Certificate(
            objective=0.0, bound=0.0, unit="captures", gap=0.0, proven=True, seconds=0.0
        )
        return _Answer(places=[() for _ in demand.views], certificate=certificate)
    unit: Literal["captures", "s"] = "captures" if (program.cost == 1.0).all() else "s"
    if budget is None:
        cover = cheapest_cover(program, limit_s=limit_s, seed=seed, progress=progress)
        if cover is not None:
            scale = 1.0 if unit == "captures" else 1e-3
            certificate = Certificate(
                objective=cover.objective * scale,
                bound=cover.lower_bound * scale,
                unit=unit,
                gap=cover.gap,
                proven=cover.gap <= _PROVEN,
                seconds=0.0,
            )
            return _Answer(places=demand.places(cover.taken), certificate=certificate)
    choice = most_within(
        program,
        _worth(demand),
        math.inf if budget is None else budget,
        limit_s=max(limit_s - (time.monotonic() - started), 0.1),
        progress=progress,
    )
    gap = (choice.bound - choice.worth) / choice.worth if choice.worth else 0.0
    certificate = Certificate(
        objective=choice.worth,
        bound=choice.bound,
        unit="features",
        gap=gap,
        proven=gap <= _PROVEN,
        seconds=0.0,
    )
    return _Answer(places=demand.places(choice.taken), certificate=certificate)


def _worth(demand: Demand) -> FloatArray:
    """Return what features count within a budget: 1, less where the confidence is out of reach."""
    targets = demand.targets[demand.asked]
    out: FloatArray = np.where(targets >= targets.max() - _DUST, 1.0, targets)
    return out


def _better_settings(
    demand: Demand,
    v: int,
    places: Places,
    limits: ExposureLimits,
    costs: CaptureCosts,
    prefer: Prefer | None,
) -> tuple[int, ...]:
    """Return as many captures of a view or fewer, with more margin or in less time.

    They serve what those that were chosen serve and no other view serves better, by the exact
    chances of several together. Without a preference none that take longer are returned.
    """
    view, chosen = demand.views[v], places[v]
    if not chosen:
        return chosen
    row = {name: i for i, name in enumerate(demand.features)}
    targets = demand.targets[[row[name] for name in view.features]]
    total = view.any_of(chosen)
    served = (targets > 0.0) & (total >= targets - _DUST)
    for other, there in enumerate(places):
        if other != v and there:
            chance = dict(
                zip(
                    demand.views[other].features,
                    demand.views[other].any_of(there).tolist(),
                    strict=True,
                )
            )
            better = np.array([chance.get(name, 0.0) for name in view.features])
            served &= ~(
                (better >= targets - _DUST) & ((better > total) | ((better == total) & (other < v)))
            )
    if not served.any():
        return chosen
    names = [name for name, each in zip(view.features, served, strict=True) if each]
    allowed = np.array([limits.allows(ms) for ms in view.settings_ms])
    if not allowed.all():
        return chosen
    asked, taken = view.take(names), targets[served]
    times = np.array([costs.capture_ms(ms) for ms in view.settings_ms])
    if prefer is not None:
        path: Path | None = chosen_path(asked, taken, limits, costs, prefer)
    elif limits.least_per_view > 1:
        return chosen
    else:
        path = cheapest_captures(asked, taken, times, most=limits.most_per_view or len(chosen) + 1)
    if path is None or (asked.any_of(path.places) < taken - _DUST).any():
        return chosen
    fewer = len(path.places) <= len(chosen)
    quicker = times[list(path.places)].sum() < times[list(chosen)].sum() - _DUST
    return path.places if (quicker if prefer is None else fewer) else chosen


def _outlook(
    demand: Demand,
    places: Places,
    confidence: float,
    limits: ExposureLimits,
    budget: float | None,
) -> tuple[FeatureOutlook, ...]:
    """Return what becomes of each feature, in the view that serves it best."""
    row = {name: i for i, name in enumerate(demand.features)}
    best: dict[str, tuple[tuple[bool, bool, float, float], FeatureOutlook]] = {}
    for view, chosen in zip(demand.views, places, strict=True):
        targets = demand.targets[[row[name] for name in view.features]]
        highest = view.chance.max(axis=1)
        for i, each in enumerate(outlook_of(view, chosen, targets, confidence, limits)):
            sure = not view.reasons[i]
            rank = (each.status == "planned", sure, each.chance, float(highest[i]))
            if each.feature not in best or rank > best[each.feature][0]:
                best[each.feature] = rank, each
    return tuple(
        _dropped(each, demand.targets[row[name]], budget)
        for name, each in ((name, best[name][1]) for name in demand.features)
    )


def _dropped(each: FeatureOutlook, target: float, budget: float | None) -> FeatureOutlook:
    """Say of a feature that could be served that the budget, or a limit, leaves it out."""
    if target == 0.0 or each.chance >= target - _DUST:
        return each
    reason = each.reason if budget is None else "the budget leaves it out"
    if each.chance >= WORTH_TRYING:
        return replace(each, reason=reason)
    return replace(each, status="not planned", view=None, exposure_ms=None, reason=reason)


def _promise(features: Sequence[FeatureOutlook]) -> Promise:
    tried = np.array([each.chance for each in features if each.status != "not planned"])
    misses = float((1.0 - tried).sum())
    return Promise(
        expected_covered=float(tried.sum()),
        expected_misses=misses,
        chance_of_all=max(1.0 - misses, 0.0),
        chance_of_all_if_independent=float(tried.prod()),
        correlation=_CORRELATION,
    )


def _certificate(plan: ExposurePlan, answer: _Answer, seconds: float) -> Certificate:
    """Return the certificate of what is planned, recomputed from the plan itself."""
    was = answer.certificate
    if was.unit == "features":
        served = max(was.objective, float(len(plan.with_status("planned"))))
        bound = max(was.bound, served)
        gap = (bound - served) / served if served else 0.0
        return replace(
            was, objective=served, bound=bound, gap=gap, proven=gap <= _PROVEN, seconds=seconds
        )
    objective = float(plan.n_captures) if was.unit == "captures" else plan.time_ms / 1000.0
    bound = min(was.bound, objective)  # exact joint chances may need fewer than single captures
    gap = (objective - bound) / objective if objective else 0.0
    return replace(
        was, objective=objective, bound=bound, gap=gap, proven=gap <= _PROVEN, seconds=seconds
    )
