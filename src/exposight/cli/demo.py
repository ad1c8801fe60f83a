"""``exposight demo``: the whole method once, on the simulated cell."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

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
    evaluated on others. They forecast a new view and choose its exposure time; the view is then
    taken and compared with the forecast. The numbers are the simulated cell's.

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
    view, summary = report.view, report.summary
    unseen = tuple(result.evaluation for result in report.results)
    known = tuple(result.training for result in report.results if result.training is not None)
    mean = view.p_norm.mean(axis=0)
    means = ", ".join(
        f"{p_norm:.2f} at {number(exposure_ms)} ms"
        for p_norm, exposure_ms in zip(mean, view.exposures_ms, strict=True)
    )
    return Result(
        facts=(
            fact("simulated", True, ""),
            fact("plan", settings.plan.name, ""),
            fact("views", summary.views),
            fact("captures", summary.captures),
            fact("observations", len(report.table)),
            fact("chosen_exposure_ms", view.exposures_ms[view.main]),
            fact("mean_p_norm", mean.tolist(), means),
            fact("output", str(output)),
        ),
        tables=(
            _scores("known", "the features that they were trained on", known),
            _scores("unseen", "unseen features", unseen),
            _new_view(report),
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
    view, chosen = report.view, report.view.main
    columns = [Column(name="feature"), Column(name="trained")]
    rows = [{"feature": name, "trained": name not in report.unseen} for name in view.features]
    for place, forecast in enumerate(view.forecasts):
        taken, names = forecast.taken, ("predicted", "low", "high")
        for name, label in zip(names, (f"by {forecast.quality}", "−2σ", "+2σ"), strict=True):
            columns.append(Column(name=f"{name}_{forecast.quality}", label=label, decimals=2))
        for i, row in enumerate(rows):
            values = (taken.p_norm, taken.p_norm_low, taken.p_norm_high)
            for name, of_all in zip(names, values, strict=True):
                row[f"{name}_{forecast.quality}"] = float(of_all[i, chosen])
            if place == 0:
                row["chance"] = float(taken.chance[i, chosen])
    columns.append(Column(name="measured_p_norm", label="measured", decimals=2))
    for i, row in enumerate(rows):
        row["measured_p_norm"] = float(view.p_norm[i, chosen])
    return Table.of(
        "new_view",
        rows,
        tuple(columns),
        title=f"A new view: {number(view.exposures_ms[chosen])} ms was chosen by forecast, then "
        "taken",
    )
