"""``exposight demo``: the whole method once, on the simulated cell."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.types import NonNegativeInt

from exposight.cli.progress import progress_bars
from exposight.cli.result import Result, Written, fact
from exposight.demo import EXPOSURE_MODEL, QUALITY_MODEL, DoorSettings, run_door
from exposight.models import model_named
from exposight.plans import PLANS
from exposight.report import write_report
from exposight.report.door import door_report
from exposight.tables import Column, Table, number

if TYPE_CHECKING:
    from exposight.demo import DoorResult

_QUICK_MODELS = ("q_k1", QUALITY_MODEL, "e_k1", EXPOSURE_MODEL)
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
    settings = DoorSettings(seed=seed)
    if quick:
        models = tuple(map(model_named, _QUICK_MODELS))
        settings = DoorSettings(seed=seed, plan=PLANS[_QUICK_PLAN], models=models, restarts=1)
    file = Written.at(output / "report.html", "report")
    with progress_bars(kept_in=output) as progress:
        result = run_door(output, settings, progress)
        progress("writing the report", 0, 1)
        write_report(file.path, door_report(result))
        progress("writing the report", 1, 1)
    view = result.new_view
    means = ", ".join(
        f"{mean:.2f} at {number(exposure_ms)} ms"
        for mean, exposure_ms in zip(view.p_norm.mean(axis=0), view.taken.exposures_ms, strict=True)
    )
    return Result(
        facts=(
            fact("simulated", True, ""),
            fact("plan", result.settings.plan.name, ""),
            fact("views", result.n_views),
            fact("captures", result.n_captures),
            fact("observations", len(result.table)),
            fact("chosen_exposure_ms", view.chosen_ms),
            fact("mean_p_norm", view.p_norm.mean(axis=0).tolist(), means),
            fact("output", str(output)),
        ),
        tables=(_models(result), _new_view(result)),
        notes=("these numbers are the simulated cell's, not a real sensor's",),
        files=(file,),
        next_step=f"info {output / 'models' / (QUALITY_MODEL + '.exposight-model')}",
    )


def _models(result: DoorResult) -> Table:
    return Table.of(
        "models",
        (
            {
                "model": trained.model.name,
                "title": trained.model.title,
                "target": trained.model.target,
                **{f"known_{key}": value for key, value in asdict(trained.known.score).items()},
                **{f"unseen_{key}": value for key, value in asdict(trained.unseen.score).items()},
                "seconds": trained.seconds,
            }
            for trained in result.results
        ),
        (
            Column(name="model"),
            Column(name="title", label="predicts", wraps=True),
            Column(name="known_r2_percent", label="known\nR² %", decimals=1),
            Column(name="known_rmse", label="known\nRMSE", digits=3, error_of="target"),
            Column(name="unseen_r2_percent", label="unseen\nR² %", decimals=1),
            Column(name="unseen_rmse", label="unseen\nRMSE", digits=3, error_of="target"),
        ),
        title="Models, on the features they were trained on and on unseen ones",
    )


def _new_view(result: DoorResult) -> Table:
    view = result.new_view
    chosen = view.taken.exposures_ms.index(view.chosen_ms)
    return Table.of(
        "new_view",
        (
            {
                "feature": name,
                "trained": name in result.train_features,
                "predicted_p_norm": float(view.taken.p_norm[i, chosen]),
                "predicted_std": float(view.taken.p_norm_std[i, chosen]),
                "measured_p_norm": float(view.p_norm[i, chosen]),
            }
            for i, name in enumerate(view.taken.features)
        ),
        (
            Column(name="feature"),
            Column(name="trained"),
            Column(name="predicted_p_norm", label="predicted\np_norm", decimals=2),
            Column(name="predicted_std", label="± 2σ", decimals=2, scale=2.0),
            Column(name="measured_p_norm", label="measured\np_norm", decimals=2),
        ),
        title=f"A new view: {number(view.chosen_ms)} ms was chosen by forecast, then taken",
    )
