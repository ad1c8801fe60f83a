"""``exposight train``: observations to models."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from exposight.cell import PRESETS, sensor_named_or_read
from exposight.cli.arguments import make_folder
from exposight.cli.hyperparameters import hyperparameter_documents, print_hyperparameters
from exposight.cli.output import (
    JsonOption,
    count,
    counted,
    note,
    number,
    print_json,
    print_line,
    print_table,
    progress_bars,
    wrote,
)
from exposight.cli.position_units import in_metres_remark
from exposight.errors import InputError, did_you_mean
from exposight.models import (
    MODEL_SUFFIX,
    MODELS,
    model_named,
    save_model,
    train_all,
)
from exposight.observing import read_observations
from exposight.workers import usual_workers

if TYPE_CHECKING:
    from exposight.cell import ActiveSensor
    from exposight.models import GaussianProcessModel, ModelSpecification
    from exposight.observing import ObservationTable

_ALL = "all"
_BEST = ("q_k4", "e_k6")

_LEAST_ROWS = 10
"""So many observations for each input a model wants."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Trained:
    model: GaussianProcessModel
    path: Path
    replaced: bool


_Observations = Annotated[
    Path,
    typer.Argument(metavar="OBSERVATIONS", help="Observation table, .csv or .parquet."),
]
_Models = Annotated[
    list[str],
    typer.Option(
        "--model",
        "-m",
        metavar="NAME",
        help=f"Model to train; give it again for more. One of "
        f"{', '.join(model.name for model in MODELS)}, or {_ALL}.",
    ),
]
_Output = Annotated[
    Path, typer.Option("--output", "-o", metavar="FOLDER", help="Folder for the model files.")
]
_Seed = Annotated[int, typer.Option(min=0, help="Seed of the restarts.")]
_Restarts = Annotated[
    int, typer.Option(min=1, help="Starts of the optimiser; the best one is kept.")
]
_Sensor = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE",
        help=f"Sensor of the observations, kept in the model: {', '.join(PRESETS)}, or its JSON "
        "file. Predicted exposure times are held against its range.",
    ),
]

_Workers = Annotated[
    int | None,
    typer.Option(
        "--workers", min=1, help="Models trained at the same time; one per core, 8 at most."
    ),
]


def train_command(
    observations: _Observations,
    models: _Models = list(_BEST),  # noqa: B006  (typer copies it)
    output: _Output = Path("models"),
    seed: _Seed = 1,
    restarts: _Restarts = 3,
    sensor: _Sensor = None,
    workers: _Workers = None,
    as_json: JsonOption = False,
) -> None:
    """Train the paper's models on observations.

    Models named q_ predict p_norm, the quality; those named e_ the exposure
    time in ms that yields a wanted brightness, learnt from observations with
    p_norm of at least 0.75. Each becomes one file, NAME.exposight-model.

    For example:

      exposight train observations.csv -m q_k4 -m e_k6 -o models/
    """
    specifications = MODELS if _ALL in models else tuple(map(_model, dict.fromkeys(models)))
    table = read_observations(observations)
    owner = None if sensor is None else sensor_named_or_read(sensor)
    if owner is not None:
        _check_exposures(table, owner)
    make_folder(output, "the models")
    sha256 = hashlib.sha256(observations.read_bytes()).hexdigest()
    with progress_bars(keep=True) as progress:
        models_trained = train_all(
            specifications,
            table,
            seed=seed,
            source=observations.name,
            source_sha256=sha256,
            sensor=owner,
            restarts=restarts,
            workers=usual_workers() if workers is None else workers,
            progress=progress,
        )
    trained = []
    for model in models_trained:
        path = output / f"{model.name}{MODEL_SUFFIX}"
        replaced = path.exists()
        save_model(path, model)
        trained.append(_Trained(model=model, path=path, replaced=replaced))
    remarks = _remarks(table, trained)
    if as_json:
        documents = map(_document, trained)
        print_json({"observations": observations, "models": documents, "remarks": remarks})
    else:
        _print(trained)
        for remark in remarks:
            note(remark)


def _model(name: str) -> ModelSpecification:
    try:
        return model_named(name)
    except InputError as error:
        msg = f"{error}, {_ALL}{did_you_mean(name, (*(own.name for own in MODELS), _ALL))}"
        raise InputError(msg) from error


def _check_exposures(table: ObservationTable, sensor: ActiveSensor) -> None:
    """Check that the sensor can have taken these exposure times: wrong unit, or wrong sensor."""
    for exposure_ms in table.array(["exposure_ms"])[:, 0].tolist():
        sensor.check_exposure(exposure_ms)


def _remarks(table: ObservationTable, trained: list[_Trained]) -> list[str]:
    """Say what of the table may not have been meant."""
    remarks = [in_metres_remark(table)]
    repeated = len(table) - table.frame.n_unique()
    if repeated:
        verb = "repeats" if repeated == 1 else "repeat"
        remarks.append(f"{counted(repeated, 'row')} of the table {verb} another one exactly")
    for done in trained:
        rows, wanted = done.model.n_observations, _LEAST_ROWS * len(done.model.inputs)
        if rows < wanted:
            remarks.append(
                f"{done.model.name} learnt from {counted(rows, 'row')} only; "
                f"{_LEAST_ROWS} for each of its inputs, {wanted}, are the least to expect much of"
            )
    return [remark for remark in remarks if remark]


def _document(done: _Trained) -> dict[str, object]:
    specification, summary = done.model.specification, done.model.summary
    return {
        "model": specification.name,
        "title": specification.title,
        "target": specification.target,
        "inputs": specification.inputs,
        "observations": done.model.n_observations,
        "emulated": done.model.provenance.emulated,
        "log_marginal_likelihood": summary.log_marginal_likelihood,
        "converged": summary.converged,
        "evaluations": summary.evaluations,
        "starts": summary.starts,
        "parameters_at_bound": summary.parameters_at_bound,
        "hyperparameters": hyperparameter_documents(done.model),
        "seconds": done.model.summary.seconds,
        "file": done.path,
        "replaced": done.replaced,
    }


def _print(trained: list[_Trained]) -> None:
    print_table(
        ("model", "predicts", "rows", "log\nlikelihood", "converged", "s"),
        (
            (
                done.model.name,
                done.model.title,
                count(done.model.n_observations),
                number(done.model.summary.log_marginal_likelihood, 5),
                "yes" if done.model.summary.converged else "no",
                f"{done.model.summary.seconds or 0.0:.1f}",
            )
            for done in trained
        ),
        words=("predicts",),
    )
    for done in trained:
        print_line("")
        print_line(done.model.name, style="bold")
        print_hyperparameters(done.model)
    print_line("")
    for done in trained:
        wrote("model", done.path, replaced=done.replaced)
    if any(done.model.provenance.emulated for done in trained):
        note("emulated exposures are among the observations; the models' files say so")
    unfinished = [done.model.name for done in trained if not _converged(done)]
    if unfinished:
        note(f"{', '.join(unfinished)} did not converge; more --restarts may help")


def _converged(done: _Trained) -> bool:
    return done.model.summary.converged
