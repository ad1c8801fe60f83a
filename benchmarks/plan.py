"""Recommended, planned and corrected exposures beside an oracle, rivals and other solvers.

Run with ``make bench NAME=plan``. Sweeps over exposure time in views and of features that no model
has learnt from (`benchmarks.plan_campaigns`) are simulated where exposight's cache does not have
them, which takes half an hour on two cores. Figures are medians over three seeds. A part of it:
``python -m benchmarks.plan rivals``, of `SECTIONS`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp

from benchmarks import plan_kills, plan_merge, plan_rivals, plan_solver, plan_views
from benchmarks.measuring import Figure, at_most, publish, say
from benchmarks.models_campaigns import COMET, SEEDS
from benchmarks.plan_campaigns import FEATURES, training_table
from exposight.geometry import RigidTransform
from exposight.models import train_window
from exposight.observing import View
from exposight.planning import CaptureChances, SensorModels
from exposight.planning.outlook import targets_of
from exposight.planning.path_search import cheapest_captures, fewest_captures
from exposight.twin.simulated_cell import scene_at

FloatArray: TypeAlias = NDArray[np.float64]

_CASES = 2000
_RUNS = 200


def single_view() -> list[Figure]:
    """Compare recommendations of one view with HiGHS on the integer program over its path."""
    wrong, cpu_s = 0, [0.0, 0.0]
    for seed in range(_CASES):
        chances = _drawn(seed)
        targets, m = targets_of(chances, 0.9), len(chances.settings_ms)
        if not (targets > 0.0).any():
            continue
        costs = 12.0 * chances.settings_ms + 500.0
        start = time.process_time()
        fewest = fewest_captures(chances, targets, costs, prefer="time", most=m)
        cheapest = cheapest_captures(chances, targets, costs, most=m)
        cpu_s[0] += time.process_time() - start
        start = time.process_time()
        expected = _program(chances, targets, costs + 1e5), _program(chances, targets, costs)
        cpu_s[1] += time.process_time() - start
        if fewest is None or cheapest is None:
            wrong += 1
            continue
        found = (costs + 1e5)[list(fewest.places)].sum(), costs[list(cheapest.places)].sum()
        right = np.allclose(found, expected, rtol=1e-9) and fewest.proven and cheapest.proven
        wrong += not right
    say(f"single views: {wrong} of {_CASES} wrong; {cpu_s[0]:.1f} s CPU, HiGHS {cpu_s[1]:.1f} s")
    return [
        Figure(name="single_view_optimal", value=int(wrong == 0), mark="1", met=wrong == 0),
        Figure(name="single_view_highs_cpu_ratio", value=cpu_s[1] / cpu_s[0], unit="×"),
        *recommend_ms(),
    ]


def recommend_ms() -> list[Figure]:
    """Time a recommendation for a view of 30 features, warm."""
    models = SensorModels(quality=train_window(training_table(SEEDS[0]), sensor=COMET))
    view = _view_of_30()
    for _ in range(3):
        recommended = models.recommend(view)
    times = []
    for _ in range(_RUNS):
        start = time.process_time()
        models.recommend(view)
        times.append(1e3 * (time.process_time() - start))
    say(f"{len(recommended.features)} features: {recommended.verdict}")
    return [at_most("recommend_ms", float(np.median(times)), 5.0, "ms")]


def _view_of_30() -> View:
    """Return a view of 30 features: those of the door, moved together until it sees all."""
    from dataclasses import replace

    whole = scene_at(None).part
    part = replace(whole, features=tuple(map(whole.feature, FEATURES)))
    shrink = 0.45
    features = tuple(
        replace(
            each,
            part_from_feature=RigidTransform(
                rotation=each.part_from_feature.rotation,
                translation_mm=each.part_from_feature.translation_mm * (shrink, shrink, 1.0),
            ),
        )
        for each in part.features
    )
    pose = COMET.camera_from_tcp @ RigidTransform(translation_mm=np.array([0.0, 0.0, 100.0]))
    return View.of(replace(part, features=features), COMET, pose, name="thirty")


def _drawn(seed: int) -> CaptureChances:
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 13)), int(rng.integers(8, 26))
    low = np.exp(rng.uniform(np.log(2.0), np.log(90.0), n))
    return CaptureChances.of_windows(
        np.column_stack([low, low * np.exp(rng.uniform(0.5, 1.8, n))]),
        np.sort(rng.choice(np.arange(2, 400), m, replace=False)).astype(float),
        features=[f"f{i}" for i in range(n)],
        std=rng.choice([0.0, 0.05, 0.2, 0.5]),
        edge_std=0.05,
    )


def _program(chances: CaptureChances, targets: FloatArray, costs: FloatArray) -> float:
    """Return the least cost of a path over settings that reaches all targets, by HiGHS."""
    m = len(costs)
    arcs = [(s, t) for s in range(-1, m) for t in range(s + 1, m + 1)]
    cost = np.array([costs[t] if t < m else 0.0 for _, t in arcs])
    gain = np.zeros((len(targets), len(arcs)))
    flow = np.zeros((m + 1, len(arcs)))
    for a, (s, t) in enumerate(arcs):
        flow[s + 1, a] += 1.0
        if t < m:
            gain[:, a] = chances.chance[:, t] if s < 0 else chances.gain[:, s, t]
            flow[t + 1, a] -= 1.0
    source = np.zeros(m + 1)
    source[0] = 1.0
    solved = milp(
        cost,
        integrality=np.ones(len(arcs)),
        bounds=Bounds(0.0, 1.0),
        options={"mip_rel_gap": 0.0},
        constraints=[
            LinearConstraint(flow, source, source),
            LinearConstraint(gain, np.where(targets > 0.0, targets - 1e-9, -np.inf), np.inf),
        ],
    )
    return float(cost @ np.round(solved.x))


SECTIONS: Mapping[str, Callable[[], list[Figure]]] = {
    "single_view": single_view,
    "solver": plan_solver.solver_figures,
    "views": plan_views.figures,
    "merge": plan_merge.figures,
    "rivals": plan_rivals.figures,
    "kills": plan_kills.kill_figures,
}


def main() -> None:
    """Carry out the sections that are named, or all, and print their figures."""
    figures = []
    for name in sys.argv[1:] or SECTIONS:
        say(f"-- {name}")
        figures += SECTIONS[name]()
    publish("exposures: recommended, planned, corrected; medians of three seeds", figures)


if __name__ == "__main__":
    main()
