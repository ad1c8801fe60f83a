"""The paper's study in its quick form: models on unseen features, calibration, findings, time.

Run with ``make bench NAME=paper``. The door is built and the loops are compiled first, where that
was not done yet, and not timed. Structured light is measured in full but for the finer grid; the
stereo sensor on an eighth of its views at a third of its exposures (`exposight.paper.campaigns`).
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measuring import Figure, at_least, at_most, publish, say
from exposight.measuring import measure_observations
from exposight.paper import CAMPAIGNS, StudyResult, StudySettings, campaign_plan, run_study
from exposight.twin import SimulatedCell
from exposight.twin.part import door

_WORKERS = 2


def warm_up() -> None:
    """Compile what is not compiled yet: one view of each sensor at one exposure time."""
    say("building the door and compiling, where this was not done yet")
    door()
    for campaign in CAMPAIGNS:
        if campaign.required:
            plan = campaign_plan(campaign, quick=True)
            plane = plan.planes[1]
            single = replace(
                plane,
                x_mm=plane.x_mm[:1],
                y_mm=plane.y_mm[:1],
                exposures_ms=plane.exposures_ms[:1],
            )
            single_plan = replace(plan, planes=(single,))
            rings_only = campaign.sensor != "stereo"
            cell = SimulatedCell.for_plan(single_plan, rings_only=rings_only)
            measure_observations(single_plan, cell)


def _row(result: StudyResult, variant: str, role: str) -> dict[str, Any]:
    """Return a variant's first line with this role, or nothing."""
    lines = result.tables.scores.rows(named=True)
    return next((row for row in lines if (row["variant"], row["role"]) == (variant, role)), {})


def unseen(result: StudyResult) -> list[Figure]:
    """Return how models do on unseen features, exposure models on those inside their range."""
    figures = []
    for prefix, suffix in (("", ""), ("s2_", "_s2")):
        for short, variant, role, unit in (
            ("q4", "q_k4", "test", "percent"),
            ("q1", "q_k1", "test", "percent"),
            ("e6", "e_k6", "test_inside", "ms"),
            ("e1", "e_k1", "test", "ms"),
        ):
            row = _row(result, f"{variant}{suffix}", role)
            r2_name = f"{prefix}{short}_test_r2_percent"
            rmse_name = f"{prefix}{short}_test_rmse_{unit}"
            figures += _marked(rmse_name, row.get("rmse"), "%" if unit == "percent" else unit)
            figures += _marked(r2_name, row.get("r2_percent"), "%")
    return figures


_AT_MOST = {
    "q1_test_rmse_percent": 18.4,
    "q4_test_rmse_percent": 10.5,
    "e6_test_rmse_ms": 13.0,
    "e1_test_r2_percent": 20.0,
}
_AT_LEAST = {"e6_test_r2_percent": 96.8}


def _marked(name: str, value: float | None, unit: str) -> list[Figure]:
    if value is None:
        return [Figure(name=name, value=None, unit=unit)]
    if name in _AT_MOST:
        return [at_most(name, value, _AT_MOST[name], unit)]
    if name in _AT_LEAST:
        return [at_least(name, value, _AT_LEAST[name], unit)]
    return [Figure(name=name, value=value, unit=unit)]


def splits(result: StudyResult) -> list[Figure]:
    """Return the validation of the best exposure model on both kinds of split, and of the linear.

    The paper scored its linear model in validation (docs/the-paper.md). Beside it stands how much
    the quality of the four training features varies.
    """
    linear = _row(result, "e_k6_lin", "validation")
    return [
        Figure(name="p_norm_std", value=float(np.std(result.dataset("X").table.array(["p_norm"])))),
        Figure(name="elin_validation_r2_percent", value=linear.get("r2_percent"), unit="%"),
        Figure(name="elin_validation_rmse_ms", value=linear.get("rmse"), unit="ms"),
        *(
            Figure(
                name=f"val_{name}_rmse_ms", value=_row(result, "e_k6", role).get("rmse"), unit="ms"
            )
            for name, role in (("random", "validation"), ("by_view", "validation_by_view"))
        ),
    ]


def calibration(result: StudyResult) -> list[Figure]:
    """Return the share of unseen observations within two predicted standard deviations."""
    figures = []
    for short, variant, role in (("q4", "q_k4", "test"), ("e6", "e_k6", "test_inside")):
        percent = _row(result, variant, role).get("coverage_2sigma_percent")
        value = None if percent is None else percent / 100
        figures.append(Figure(name=f"coverage_2sigma_{short}", value=value))
    return figures


def findings(result: StudyResult) -> list[Figure]:
    """Say which of the paper's statements hold here, and count them."""
    words = {True: "true ", False: "false", None: "?    "}
    for finding in result.findings:
        figure = "–" if finding.figure is None else f"{finding.figure:.3g}"
        say(
            f"  {words[finding.holds]} {finding.name}: {figure} {finding.comparison} "
            f"{finding.threshold:g} {finding.unit}"
        )
    return [
        Figure(name="findings_true", value=sum(own.holds is True for own in result.findings)),
        Figure(name="findings_total", value=len(result.findings)),
    ]


class _Stages:
    """Times each stage of a study."""

    def __init__(self) -> None:
        self.began: dict[str, float] = {}

    def __call__(self, stage: str, done: int, total: int) -> None:
        now = time.perf_counter()
        self.began.setdefault(stage, now)
        if done == total:
            say(f"  {stage}: {total}, {now - self.began[stage]:.1f} s")


def main() -> None:
    """Carry out the quick study from nothing."""
    warm_up()
    with tempfile.TemporaryDirectory() as name:
        start = time.perf_counter()
        settings = StudySettings(quick=True, workers=_WORKERS)
        result = run_study(Path(name), settings, _Stages())
        took_s = time.perf_counter() - start
    publish(
        "the paper's study, quick",
        [
            *unseen(result),
            *splits(result),
            *calibration(result),
            *findings(result),
            at_most("quick_s", took_s, 240, "s"),
        ],
    )


if __name__ == "__main__":
    main()
