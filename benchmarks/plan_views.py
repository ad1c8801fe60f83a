"""Views chosen by `exposight.planning.viewing.viewpoints`, a plan over them, known outcomes.

30 holes of the simulated door, 48 poses that nobody chose by hand, a plan of forecasts over them,
against the plan of somebody who knows every outcome.
"""

from __future__ import annotations

import statistics
import time
from functools import cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.measuring import Figure, at_least, at_most, publish, say
from benchmarks.models_campaigns import COMET, SEEDS, observed
from benchmarks.plan_campaigns import FEATURES, TIMES_MS, training_table
from exposight.cell import Part
from exposight.geometry.meshes.triangle_meshes import Mesh
from exposight.models import P_NORM_MIN, train_window
from exposight.observing import ObservationTable
from exposight.planning import CaptureCosts, ExposureLimits
from exposight.planning.capture_chances import CaptureChances
from exposight.planning.covering.cover import plan_exposures
from exposight.planning.exposure_plan import ExposurePlan
from exposight.planning.viewing.viewpoints import CandidateViewpoints, candidate_views
from exposight.plans import MeasuringPlan, PoseList
from exposight.twin import SimulatedCell
from exposight.twin.simulated_cell import scene_at

_VIEWS = 48
_SEED = 1
_CONFIDENCE = 0.9
_COSTS = CaptureCosts(frames=12, overhead_ms=500.0, move_ms=3000.0)
_TRIES = 5
"""Further captures for a feature that a plan missed."""

Outcomes: TypeAlias = dict[tuple[str, float], frozenset[str]]
"""What a capture, a view at an exposure time, gives: the features that reach what is needed."""


@cache
def chosen_views() -> tuple[Part, CandidateViewpoints]:
    """Return the door with 30 holes of its inside, and poses from which they are seen."""
    scene = scene_at(None)
    whole = scene.part_with_finishes()
    part = Part(name=whole.name, features=tuple(map(whole.feature, FEATURES)))
    mesh = Mesh(vertices=scene.vertices, faces=scene.faces)
    return part, candidate_views(part, COMET, mesh=mesh, count=_VIEWS, seed=_SEED)


def views_plan() -> MeasuringPlan:
    """Return the plan that takes every view at every exposure time."""
    _, views = chosen_views()
    poses = PoseList.from_transforms(
        "auto", list(views.poses.values()), names=tuple(views.poses), exposures_ms=TIMES_MS
    )
    return MeasuringPlan(
        name="auto-views", sensor=COMET, features=FEATURES, poses=(poses,), seed=_SEED
    )


def outcomes() -> ObservationTable:
    """Return what every view gives at every exposure time, simulated where it is not kept."""
    plan = views_plan()
    cell = SimulatedCell.for_plan(plan, rings_only=True)
    return observed("auto-views", plan, cell)


@cache
def truth() -> Outcomes:
    """Return what every capture gives."""
    given: dict[tuple[str, float], set[str]] = {}
    good = outcomes().measured().with_quality(P_NORM_MIN).frame
    for view, exposure_ms, feature in good.select("view", "exposure_ms", "feature").iter_rows():
        given.setdefault((view, exposure_ms), set()).add(feature)
    return {capture: frozenset(features) for capture, features in given.items()}


def known_chances() -> list[CaptureChances]:
    """Return the chances, 0 or 1, of somebody who knows every outcome."""
    _, views = chosen_views()
    known, nothing = truth(), frozenset[str]()
    return [
        CaptureChances.by_themselves(
            [[float(f in known.get((v.name, t), nothing)) for t in TIMES_MS] for f in v.features],
            TIMES_MS,
            features=v.features,
            need=P_NORM_MIN,
            view=v.name,
        )
        for v in views.views
    ]


def forecast_chances(seed: int) -> list[CaptureChances]:
    """Return the chances that models trained on other views and nine of the holes give."""
    part, views = chosen_views()
    model = train_window(training_table(seed))
    return [
        CaptureChances.of_rings(
            model.forecast(v.view(part, COMET).frame, TIMES_MS), TIMES_MS, view=v.name
        )
        for v in views.views
    ]


def planned(chances: list[CaptureChances]) -> ExposurePlan:
    """Return the plan that takes least time."""
    return plan_exposures(
        chances, ExposureLimits.of(COMET), _COSTS, goal="time", confidence=_CONFIDENCE
    )


def captures_of(plan: ExposurePlan) -> list[tuple[str, float]]:
    """Return view and exposure time of a plan's captures, in their order."""
    return [(view.name, each.exposure_ms) for view in plan.views for each in view.exposures]


def seconds(captures: list[tuple[str, float]]) -> float:
    """Return what captures take; going to another view is a move."""
    views = [view for view, _ in captures]
    moves = sum(1 for i, view in enumerate(views) if i == 0 or views[i - 1] != view)
    times_ms = sum(_COSTS.capture_ms(exposure_ms) for _, exposure_ms in captures)
    return (times_ms + moves * _COSTS.move_ms) / 1000.0


def caught_up(
    captures: list[tuple[str, float]], chances: list[CaptureChances]
) -> list[tuple[str, float]]:
    """Return the captures of a plan, and those that features take which it missed.

    Each missed feature is looked at where its chance is best of all captures not taken yet.
    """
    known, nothing = truth(), frozenset[str]()
    all_taken = list(captures)

    def had() -> frozenset[str]:
        return nothing.union(*(known.get(capture, nothing) for capture in all_taken))

    for feature in FEATURES:
        for _ in range(_TRIES):
            if feature in had():
                break
            offers = [
                (float(chance), view.view, float(time_ms))
                for view in chances
                if feature in view.features
                for chance, time_ms in zip(
                    view.chance[view.features.index(feature)], view.settings_ms, strict=True
                )
                if (view.view, float(time_ms)) not in all_taken
            ]
            _, name, time_ms = max(offers)
            all_taken.append((name, time_ms))
    return all_taken


def figures() -> list[Figure]:
    """Plan from forecasts, execute, and compare with who knows every outcome."""
    start = time.process_time()
    _, views = chosen_views()
    chosen_s = time.process_time() - start
    seen = [len(view.features) for view in views.views]
    say(
        f"{len(views.views)} views see {statistics.mean(seen):.1f} of {len(FEATURES)} features each"
    )
    best = captures_of(planned(known_chances()))
    say(f"who knows: {len(best)} captures, {seconds(best):.2f} s")
    ratios, shares, extra = [], [], []
    for seed in SEEDS:
        chances = forecast_chances(seed)
        plan = planned(chances)
        captures = captures_of(plan)
        given: NDArray[np.bool_] = np.array(
            [any(f in truth().get(c, ()) for c in captures) for f in FEATURES]
        )
        every = caught_up(captures, chances)
        ratios.append(seconds(every) / seconds(best))
        shares.append(float(given.mean()))
        extra.append(len(every) - len(captures))
        unsure = sum(bool(reason) for view in chances for reason in view.reasons) / sum(seen)
        say(
            f"seed {seed}: {len(captures)} captures in {len(plan.views)} views, "
            f"{seconds(captures):.2f} s, {given.sum()} of {len(FEATURES)} had, {extra[-1]} further "
            f"captures; promised {plan.promise.expected_covered:.2f}; {unsure:.0%} of pairs not "
            "relied on"
        )
    return [
        at_most("views_auto_time_over_oracle", statistics.median(ratios), 1.10),
        at_least("views_auto_covered_share", statistics.median(shares), 0.99),
        Figure(name="views_auto_further_captures", value=statistics.median(extra)),
        Figure(name="views_auto_oracle_s", value=seconds(best), unit="s"),
        Figure(name="views_auto_cpu_s", value=chosen_s, unit="s"),
    ]


if __name__ == "__main__":
    publish("Views and exposures of 30 holes", figures())
