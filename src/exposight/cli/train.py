"""``exposight train``: observations to models."""

import hashlib
import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.types import NonNegativeInt, PositiveInt

from exposight.cell import sensor_named_or_read
from exposight.cli.result import Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.files import make_folder
from exposight.models import (
    MODEL_SUFFIX,
    MODELS,
    GaussianProcessModel,
    Predictor,
    model_named,
    save_model,
    train_all,
)
from exposight.observing import ObservationTable, read_observations
from exposight.planning import DEFAULT_MODELS
from exposight.tables import Column, Table, counted
from exposight.workers import usual_workers

_ALL = "all"
_LEAST_ROWS = 10
"""So many observations for each input a model wants."""


def train_command(
    observations: Path,
    /,
    *,
    names: Annotated[
        tuple[str, ...], Parameter(("--model", "-m"), metavar="NAME")
    ] = DEFAULT_MODELS,
    output: Annotated[Path, Parameter(alias="-o")] = Path("models"),
    seed: NonNegativeInt = 1,
    restarts: PositiveInt = 3,
    sensor: Annotated[str | None, Parameter(metavar="NAME|FILE")] = None,
    workers: PositiveInt | None = None,
    cluster: Annotated[str | None, Parameter(metavar="ADDRESS")] = None,
) -> Result:
    """Train models on observations.

    Models named q_ predict p_norm, the quality; those named e_ the exposure time in ms that yields
    a given brightness, learnt from observations with p_norm of at least 0.75. Each is written to
    one file, NAME.exposight-model.

    For example:

        exposight train observations.csv -m q_k4 -m e_k6 -o models/

    Parameters
    ----------
    observations
        Observation table, .csv or .parquet.
    names
        Model to train: one of the paper's (q_k1 … q_k6, e_k1 … e_k6_lin), or all. Repeat for more.
    output
        Folder for the model files.
    seed
        Random seed.
    restarts
        Starts of the optimiser; the best is kept.
    sensor
        Sensor of the observations, kept in the model: a preset's name or a JSON file. Predicted
        exposure times are compared with its range.
    workers
        Train this many models in parallel; one for each core by default, at most 8.
    cluster
        Train on a Dask scheduler's workers, tcp://host:8786.
    """
    specifications = MODELS if _ALL in names else tuple(map(model_named, dict.fromkeys(names)))
    table = read_observations(observations)
    parameterer = None if sensor is None else sensor_named_or_read(sensor)
    make_folder(output, "the models")
    sha256 = hashlib.sha256(observations.read_bytes()).hexdigest()
    with progress_bars() as progress:
        models = train_all(
            specifications,
            table,
            seed=seed,
            source=observations.name,
            source_sha256=sha256,
            sensor=parameterer,
            restarts=restarts,
            workers=workers or (1 if cluster else usual_workers()),
            cluster=cluster,
            progress=progress,
        )
    files = []
    for model in models:
        files.append(Written.at(output / f"{model.name}{MODEL_SUFFIX}", "model"))
        save_model(files[-1].path, model)
    return Result(
        facts=(fact("observations", str(observations)), fact("seed", seed)),
        tables=(_summary(models, files), *map(hyperparameter_table, models)),
        notes=tuple(_notes(table, models)),
        files=tuple(files),
    )


def _notes(table: ObservationTable, models: Sequence[GaussianProcessModel]) -> list[str]:
    """Return what of the table may not have been meant, and what of the fits may disappoint."""
    notes = list(table.remarks())
    for model in models:
        rows, wanted = model.n_observations, _LEAST_ROWS * len(model.inputs)
        if rows < wanted:
            notes.append(
                f"{model.name} learnt from {counted(rows, 'row')} only; "
                f"{_LEAST_ROWS} for each of its inputs, {wanted}, are the least to expect much of"
            )
    if any(model.provenance.emulated for model in models):
        notes.append("emulated exposures are among the observations; the models' files say so")
    unfinished = [model.name for model in models if not model.summary.converged]
    if unfinished:
        notes.append(f"{', '.join(unfinished)} did not converge; more --restarts may help")
    return notes


def _summary(models: Sequence[GaussianProcessModel], files: Sequence[Written]) -> Table:
    return Table.of(
        "models",
        (
            {
                "model": model.name,
                "title": model.title,
                "target": model.target,
                "inputs": model.inputs,
                "observations": model.n_observations,
                "experts": model.experts,
                "emulated": model.provenance.emulated,
                **asdict(model.summary),
                "file": str(file.path),
            }
            for model, file in zip(models, files, strict=True)
        ),
        (
            Column(name="model"),
            Column(name="title", label="predicts", wraps=True),
            Column(name="observations", label="rows"),
            Column(name="log_marginal_likelihood", label="log\nlikelihood", digits=5),
            Column(name="converged"),
            Column(name="seconds", label="s", decimals=1),
        ),
    )


def hyperparameter_table(model: Predictor) -> Table:
    """Return a model's hyperparameters with what they act on and their units."""
    return Table.of(
        f"hyperparameters_of_{model.name}",
        (
            {
                "hyperparameter": re.sub(r"[._]|\[.*", " ", parameter.name).strip(),
                **asdict(parameter),
            }
            for parameter in model.hyperparameters()
        ),
        (
            Column(name="hyperparameter", wraps=True),
            Column(name="inputs", label="acts on", wraps=True),
            *(Column(name=name) for name in ("value", "unit", "remark")),
        ),
        title=model.name,
    )
