"""``exposight evaluate``: models held against observations."""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from exposight.cli.exposure_units import exposure_unit_remark
from exposight.cli.output import (
    JsonOption,
    count,
    note,
    number,
    percent,
    print_json,
    print_line,
    print_table,
)
from exposight.cli.position_units import position_unit_remark
from exposight.models import MODEL_SUFFIX, GaussianProcessModel, evaluate, load_model
from exposight.observing import read_observations

if TYPE_CHECKING:
    from exposight.models import Evaluation, GaussianProcessModel
    from exposight.statistics import RegressionScore

_Models = Annotated[
    list[Path], typer.Argument(metavar="MODEL", help="Model files that train wrote.")
]
_Observations = Annotated[
    Path, typer.Argument(metavar="OBSERVATIONS", help="Observation table, .csv or .parquet.")
]


def evaluate_command(
    *,
    models: _Models = [],  # noqa: B006  (typer copies it)
    observations: _Observations,
    as_json: JsonOption = False,
) -> None:
    """Hold models against observations that they have not seen.

    R², mean squared error (MSE), its root (RMSE) and mean absolute error (MAE),
    for all rows and for those inside the range of the training data, beyond
    which a model extrapolates. The last columns are the shares of observations
    within one and two predicted standard deviations; 68.3 and 95.4 % is right.

    For example:

      exposight evaluate models/q_k4.exposight-model test.csv
    """
    _check_order(models, observations)
    table = read_observations(observations)
    sha256 = hashlib.sha256(observations.read_bytes()).hexdigest()
    loaded = [load_model(path, GaussianProcessModel) for path in models]
    results = [evaluate(model, table) for model in loaded]
    known = [model.provenance.observations_sha256 == sha256 for model in loaded]
    exposures = table.array(["exposure_ms"])[:, 0]
    remarks = [
        "; ".join(
            filter(
                None,
                (
                    exposure_unit_remark(model, exposures),
                    position_unit_remark(model, table.measured().frame),
                ),
            )
        )
        for model in loaded
    ]
    if as_json:
        documents = [
            {**_document(path, model, result, seen), "remark": remark}
            for path, model, result, seen, remark in zip(
                models, loaded, results, known, remarks, strict=True
            )
        ]
        print_json({"observations": observations, "models": documents})
        return
    print_line(f"against {observations}, {count(len(table))} rows", style="bold")
    print_table(
        ("model", "rows", "n", "R²\n%", "MSE", "RMSE", "MAE", "±1σ\n%", "±2σ\n%"),
        [row for result in results for row in _rows(result)],
        words=("rows",),
    )
    names = [result.model.name for result in results]
    seen_names = [name for name, seen in zip(names, known, strict=True) if seen]
    if seen_names:
        note(f"{', '.join(seen_names)} learnt from this very table; only unseen features tell")
    if bool(table.measured().frame["emulated"].any()):
        note("emulated exposures are among the observations")
    for remark in filter(None, remarks):
        note(remark)


def _check_order(models: list[Path], observations: Path) -> None:
    """Check that the table comes last, after one model at least."""
    form = "exposight evaluate MODEL... OBSERVATIONS"
    if observations.suffix == MODEL_SUFFIX:
        tables = [path for path in models if path.suffix.lower() in {".csv", ".parquet"}]
        msg = f"the observations are missing: {form}"
        if tables:
            msg = f"the observations, {tables[0]}, come last: {form}"
        raise typer.BadParameter(msg)
    if not models:
        msg = f"the models are missing: {form}"
        raise typer.BadParameter(msg)


def _document(
    path: Path, model: GaussianProcessModel, result: Evaluation, known: bool
) -> dict[str, object]:
    return {
        "file": path,
        "model": model.name,
        "target": model.target,
        "unit": model.unit,
        "trained_on_this_table": known,
        "all": asdict(result.score),
        "inside_training_range": asdict(result.score_inside) if result.score_inside else None,
    }


def _rows(result: Evaluation) -> list[tuple[str, ...]]:
    name, target = result.model.name, result.model.target
    rows = [(name, "all", *_cells(result.score, target))]
    if result.score_inside is None:
        rows.append(("", "inside", "0", *("–",) * 6))
    else:
        rows.append(("", "inside", *_cells(result.score_inside, target)))
    return rows


def _cells(score: RegressionScore, target: str) -> tuple[str, ...]:
    # Errors of p_norm in percent of full scale, as the paper quotes them.
    scale, unit = (100.0, "%") if target == "p_norm" else (1.0, "ms")
    return (
        count(score.n),
        number(score.r2_percent),
        number(score.mse, 3),
        f"{number(scale * score.rmse, 3)} {unit}",
        f"{number(scale * score.mae, 3)} {unit}",
        percent(score.coverage_1sigma),
        percent(score.coverage_2sigma),
    )
