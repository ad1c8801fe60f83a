"""``exposight demo``: the whole method once, on the simulated cell."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import polars as pl
from cyclopts import Parameter
from cyclopts.types import NonNegativeInt

from exposight.cli.result import Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.models import QUALITY, Evaluation
from exposight.planning import ModelScores
from exposight.plans import PLANS
from exposight.report import (
    CampaignReport,
    DemonstrationSettings,
    run_demonstration,
)
from exposight.tables import Column, Table, number

_QUICK_PLAN = "small"


def demo_command(
    *,
    output: Annotated[Path, Parameter(alias="-o")] = Path("demo-output"),
    seed: NonNegativeInt = 1,
    quick: bool = False,
) -> Result:
    """Run the whole method once on a simulated cell.

    A car door of bare sheet metal is measured, models are trained on some of its features and
    evaluated on others. They say which exposures to take of a new view and which features will
    fail; then these are taken, and promised is compared with achieved. The numbers are the
    simulated cell's.

    Writes report.html, which opens without a network. Captures are kept: run it again after an
    interruption and it goes on.

    For example:

        exposight demo

    Parameters
    ----------
    output
        Folder for the report, campaign, observations and models.
    seed
        Random seed.
    quick
        Use fewer views and train fewer models.
    """
    settings = DemonstrationSettings(seed=seed)
    if quick:
        settings = DemonstrationSettings(seed=seed, plan=PLANS[_QUICK_PLAN], restarts=1)
    file = Written.at(output / "report.html", "report")
    with progress_bars(kept_in=output) as progress:
        report = run_demonstration(output, settings, progress)
        progress("writing the report", 0, 1)
        report.write(output)
        progress("writing the report", 1, 1)
    summary = report.summary
    unseen = tuple(result.evaluation for result in report.results)
    known = tuple(result.training for result in report.results if result.training is not None)
    promise = report.content["promise"]
    said = promise.recommended
    n = len(said.features)
    single = f"{promise.n_single} of {n}, at {number(promise.single_ms)} ms"
    return Result(
        title=". ".join(
            (
                f"{said.verdict[0].upper()}{said.verdict[1:]}",
                *(f"{name} will fail: {reason}" for name, reason in promise.failing.items()),
                f"Taken: {promise.n_achieved} of {n} did",
            )
        ),
        facts=(
            fact("exposures_ms", list(said.exposures_ms), ""),
            fact("promised", said.expected, f"{said.expected:.1f} of {n} features"),
            fact("achieved", promise.n_achieved, f"{promise.n_achieved} of {n}"),
            fact("best_single_exposure", promise.n_single, single),
            fact("simulated", True, ""),
            fact("plan", settings.plan.name, ""),
            fact("views", summary.views),
            fact("captures", summary.captures),
            fact("observations", len(report.table)),
            fact("output", str(output)),
        ),
        tables=(
            _new_view(report),
            _scores("known", "the features that they were trained on", known),
            _scores("unseen", "unseen features", unseen),
        ),
        notes=("these numbers are the simulated cell's, not a real sensor's",),
        files=(file,),
        next_step=f"info {output / 'models' / (QUALITY + '.exposight-model')}",
    )


def _scores(name: str, features: str, evaluations: tuple[Evaluation, ...]) -> Table:
    table = ModelScores(evaluations=evaluations).table
    rows = table.frame.filter(rows="all")
    columns = tuple(each for each in table.columns if each.name != "rows")
    title = f"Models on {features}"
    return replace(table, name=name, title=title, frame=rows, columns=columns)


def _new_view(report: CampaignReport) -> Table:
    """Return what was promised of each feature, and what was achieved."""
    promise = report.content["promise"]
    frame = promise.recommended.frame.with_columns(
        pl.col("feature").replace_strict(promise.achieved, default=None).alias("measured_p_norm"),
        (~pl.col("feature").is_in(list(report.unseen))).alias("trained"),
    )
    columns = (
        Column(name="feature"),
        Column(name="trained"),
        Column(name="exposure_ms", label="served at\nms", digits=4),
        Column(name="chance", label="promised\n%", decimals=1, scale=100.0),
        Column(name="measured_p_norm", label="measured\np_norm", decimals=2),
    )
    return Table(name="new_view", frame=frame, columns=columns, title="The new view")
