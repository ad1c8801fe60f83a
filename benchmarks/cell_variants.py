"""How the study's main scores change with two settings of the simulated sensor.

Run with ``make bench NAME=cell_variants``; some five minutes on two cores. The structured-light
campaigns of the quick study are measured with the cell as it is, with brightness averaged in the
first of the finest stripe images instead of their mean, and with two limits on depth noise: 0.5 mm,
near what is predicted for a ring of 25 grey levels at the TCP (0.43 mm), where the paper's Fig. 10
ends its rise, and half of that. Nothing is chosen by what comes out: the study's cell keeps
its settings. The paper's own scores stand in the last rows.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from typing import Any

import numpy as np

from benchmarks.measuring import Figure, publish, say
from exposight.measuring import measure_observations
from exposight.models import Training
from exposight.observing import ObservationTable
from exposight.paper import (
    CAMPAIGNS,
    DATASETS,
    VARIANTS,
    StudySettings,
    build_dataset,
    campaign_plan,
    score_variant,
)
from exposight.paper.study_tables import published_scores
from exposight.twin import SimulatedCell
from exposight.workers import LocalProcesses

_WORKERS = 2
_SETTINGS = StudySettings(sensors=("structured-light",), quick=True)
_CAMPAIGNS = ("inside", "finer")
"""Campaigns that the judged variants learn from and are judged by."""

CELLS: Mapping[str, Mapping[str, Any]] = {
    "default": {},
    "first_image": {"image": "first"},
    "noise_below_0.5_mm": {"max_depth_noise_mm": 0.5},
    "noise_below_0.25_mm": {"max_depth_noise_mm": 0.25},
}
"""Tables of the simulated sensor (`exposight.twin.sensors.SensorSettings`), by what they are called
here."""

_JUDGED = (
    ("q1", "q_k1", "test", "X1_test", "percent"),
    ("q4", "q_k4", "test", "X4_test", "percent"),
    ("e1", "e_k1", "test", "eX1_test", "ms"),
    ("e6", "e_k6", "test_inside", "eX6_test_i", "ms"),
)
"""Short name, variant, which unseen features judge it, the paper's dataset, unit of the RMSE."""

_PAPER_P_NORM_STD = 0.389
"""Of the unseen features' rows, √(MSE/(1 − R²)) in the paper's Table 2."""


def observe(table: Mapping[str, Any]) -> dict[str, ObservationTable]:
    """Carry out the campaigns, as far as the quick study does, with a sensor's table."""
    tables = {}
    for campaign in CAMPAIGNS:
        if campaign.name in _CAMPAIGNS:
            plan = campaign_plan(campaign, quick=_SETTINGS.quick)
            cell = SimulatedCell.for_plan(plan, rings_only=True, sensor=table)
            tables[campaign.name] = measure_observations(plan, cell, workers=_WORKERS)
    return tables


def judge(task: tuple[str, Mapping[str, ObservationTable]]) -> list[Figure]:
    """Train the judged variants on what a cell gave, and judge them on unseen features."""
    name, tables = task
    datasets = {
        each.name: build_dataset(each, tables, _SETTINGS)
        for each in DATASETS
        if each.sensor in _SETTINGS.sensors
    }
    variants = {variant.name: variant for variant in VARIANTS}
    p_norm = datasets["X_test"].table.frame["p_norm"].to_numpy()
    figures = [Figure(name=f"{name}_p_norm_std", value=float(np.std(p_norm)))]
    for short, variant_name, role, _, unit in _JUDGED:
        variant = variants[variant_name]
        rows = datasets[variant.dataset].train
        if rows is None:
            msg = f"dataset {variant.dataset} has no training side"
            raise RuntimeError(msg)
        training = Training(
            specification=variant.specification, table=rows, seed=_SETTINGS.seed, restarts=1
        )
        model = training.run()
        (score,) = (
            each.score
            for each in score_variant(
                variant, model, datasets, train_by_view=model.with_training_rows
            )
            if each.evaluation.role == role
        )
        if score is None:
            msg = f"no unseen observation judges {variant_name}"
            raise RuntimeError(msg)
        rmse = 100.0 * score.rmse if unit == "percent" else score.rmse
        figures += [
            Figure(name=f"{name}_{short}_rmse_{unit}", value=rmse, unit=variant.unit),
            Figure(name=f"{name}_{short}_r2_percent", value=score.r2_percent, unit="%"),
        ]
    return figures


def paper() -> list[Figure]:
    """Return the paper's scores of the same models."""
    figures = [Figure(name="paper_p_norm_std", value=_PAPER_P_NORM_STD)]
    for short, variant, _, dataset, unit in _JUDGED:
        row = published_scores()[variant, dataset, "f1-4_test"]
        figures += [
            Figure(
                name=f"paper_{short}_rmse_{unit}",
                value=row["rmse"],
                unit="%" if unit == "percent" else unit,
            ),
            Figure(name=f"paper_{short}_r2_percent", value=row["r2_percent"], unit="%"),
        ]
    return figures


def main() -> None:
    """Measure with every cell, and train on each."""
    tasks = []
    for name, table in CELLS.items():
        say(f"measuring: {name}")
        tasks.append((name, observe(table)))
    say("training and judging")
    with closing(LocalProcesses(_WORKERS).run(judge, tasks)) as results:
        judged = {task[0]: figures for task, figures in results}
    figures = [figure for name in CELLS for figure in judged[name]]
    publish("the study's main scores by settings of the sensor", [*figures, *paper()])


if __name__ == "__main__":
    main()
