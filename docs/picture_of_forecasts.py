"""Holes that nobody trained on, in a view that nobody took: forecasts beside what was measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
from matplotlib import pyplot as plt
from picture_style import ACCENT, ACCENT_2, INK, QUIET, save

from exposight.measuring import measure_observations
from exposight.observing import View
from exposight.planning import SensorModels, train
from exposight.plans import MeasuringPlan, plan_preset
from exposight.plans.positions import RandomPositions, logarithmic_exposures
from exposight.twin import SimulatedCell

_UNSEEN = ("f1_test", "f2_test", "f3_test", "f4_test")
_BEFORE, _NOW = ("q_k4", "e_k6"), ("quality", "exposure")


def _plans() -> tuple[MeasuringPlan, MeasuringPlan]:
    """Return half of the paper's views at every second exposure time, and one new view."""
    plan = plan_preset("inside")
    planes = tuple(
        replace(plane, y_mm=plane.y_mm[::2], exposures_ms=plane.exposures_ms[::2])
        for plane in plan.planes
    )
    features = tuple(name for name in plan.features if name not in _UNSEEN)
    new = RandomPositions(
        name="new",
        count=4,
        x_mm=(-150, 150),
        y_mm=(-100, 100),
        z_tcp_mm=(-100, 100),
        exposures_ms=logarithmic_exposures(3, 500, 24, plan.sensor),
    )
    return (
        replace(plan, features=features, planes=planes),
        replace(plan, features=_UNSEEN, planes=(), random=(new,), simulated={}, seed=5),
    )


def draw_forecasts() -> None:
    """Train both pairs of models on the same captures, and forecast a view before it is taken."""
    learnt_plan, new_plan = _plans()
    learnt, taken = (
        measure_observations(plan, SimulatedCell.for_plan(plan, rings_only=True), workers=2)
        for plan in (learnt_plan, new_plan)
    )
    rows = taken.measured().frame
    view = (
        rows.group_by("view").agg(pl.col("feature").n_unique()).sort("feature", "view")["view"][-1]
    )
    rows = rows.filter(pl.col("view") == view)
    rings = rows.unique("feature", maintain_order=True)
    times_ms = np.geomspace(3.0, 500.0, 160).tolist()
    pairs: dict[str, tuple[str, SensorModels]] = {
        "the paper's chain, q_k4 with e_k6": (ACCENT_2, train(learnt, models=_BEFORE)),
        "quality and exposure": (ACCENT, train(learnt, models=_NOW)),
    }
    cell = SimulatedCell.for_plan(new_plan)
    part = new_plan.observed_part(cell.part)
    pose = next(each for each in new_plan.views(cell.part) if each.name == view).camera_from_part
    seen = View.of(part, new_plan.sensor, pose, name=view)
    figure, panels = plt.subplots(
        1, rings.height, figsize=(10, 3.1), sharey=True, layout="constrained"
    )
    for label, (colour, models) in pairs.items():
        forecast = models.forecast(seen, times_ms)
        for axes, name in zip(panels, rings["feature"], strict=True):
            i = forecast.features.index(name)
            low = np.clip(forecast.p_norm_low[i], 0.0, 1.0)
            high = np.clip(forecast.p_norm_high[i], 0.0, 1.0)
            axes.fill_between(times_ms, low, high, color=colour, alpha=0.22, linewidth=0)
            axes.plot(times_ms, forecast.p_norm[i], color=colour, linewidth=1.6, label=label)
    for axes, name in zip(panels, rings["feature"], strict=True):
        one = rows.filter(pl.col("feature") == name)
        axes.plot(
            one["exposure_ms"], one["p_norm"], "o", color=INK, markersize=3, label="measured after"
        )
        axes.set(xscale="log", ylim=(-0.04, 1.08), title=name.replace("_", " "))
        axes.set_xlabel("exposure time / ms")
        axes.axhline(0.75, color=QUIET, linewidth=0.7, linestyle=":")
    panels[0].set_ylabel("share of points, $p_{norm}$")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle("Numbers of the simulated cell, not of a real part", fontsize=9, color=QUIET)
    save(figure, "forecasts")
    plt.close(figure)
