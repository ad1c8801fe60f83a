"""``exposight train``: observations to models."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from cyclopts.types import NonNegativeInt, PositiveInt

from exposight.cell import PRESETS, ActiveSensor, CampaignFolder, sensor_named_or_read
from exposight.cli.app import UsageError
from exposight.cli.cluster_options import NO_CLUSTER, ClusterOptions
from exposight.cli.model_facts import hyperparameter_table, left_out_table, model_facts
from exposight.cli.result import Result, Written, fact
from exposight.cli.terminal import progress_bars
from exposight.contradictions import Contradiction, settle
from exposight.contradictions.observed_rows import exposure_unit
from exposight.errors import InputError, did_you_mean
from exposight.files import make_folder
from exposight.models import (
    MODEL_SUFFIX,
    MODELS,
    Better,
    GaussianProcessModel,
    MeanKind,
    ModelSpecification,
    Predictor,
    RadianceModel,
    Training,
    WindowModel,
    keeps_limits,
    load_model,
    model_named,
    save_model,
    train_all,
    train_response,
    train_window,
)
from exposight.models.ring_data import GRAZING_DEG, without_grazing
from exposight.observing import ObservationTable, observe_campaign, read_observations
from exposight.planning import DEFAULT_MODELS
from exposight.tables import Column, Table, counted, number
from exposight.workers import usual_workers

_ALL = "all"
_WORTH_SAYING_S = 2.0
"""Trainings that take longer are foretold."""

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
    sensor: Annotated[str | None, Parameter(metavar="NAME|FILE")] = None,
    start_from: Annotated[Path | None, Parameter("--from", metavar="MODEL")] = None,
    mean: MeanKind | None = None,
    target: Annotated[tuple[str, ...], Parameter(metavar="COLUMN")] = (),
    better: Better | None = None,
    seed: NonNegativeInt = 1,
    restarts: PositiveInt = 3,
    workers: PositiveInt | None = None,
    cluster: ClusterOptions = NO_CLUSTER,
) -> Result:
    """Train models on observations, or on a campaign.

    By default two models that belong together, in seconds: quality predicts p_norm over exposure
    time from a feature's pose, exposure the time in ms that yields a given brightness. They know
    how light falls on a ring and learn how its surface reflects it, and between which brightnesses
    the sensor gives points; they hold for one sensor and one finish.

    The paper's Gaussian processes are named: q_k1 … q_k6 predict p_norm from brightness, e_k1 …
    e_k6_lin the exposure time, learnt from observations with p_norm of at least 0.75. Each model is
    written to one file, NAME.exposight-model.

    For example:

        exposight train observations.csv -o models/

        exposight train door-inside/ -o models/

        exposight train painted.csv --from models/quality.exposight-model -o painted/

        exposight train observations.csv --target diameter_error_mm -o models/

        exposight train observations.csv -m q_k4 -m e_k6 -o models/

    Parameters
    ----------
    observations
        Observation table, .csv or .parquet; or a campaign's folder, which is observed first, its
        table kept beside the models.
    names
        Model to train: quality, exposure, one of the paper's, or all. Repeat for more.
    output
        Folder for the model files.
    sensor
        Sensor of the observations, kept in the model: a preset's name or a JSON file; the preset
        that the table names, or the campaign's, by default.
    start_from
        quality model of the same sensor on another finish: the sensor's limits are kept, but for a
        few percent, and the surface is learnt anew; a few captures are enough.
    mean
        What the default models know of the light: where the projector and the camera stand, only
        the camera, or none; as much as the sensor's document allows by default.
    target
        Also learn how this column depends on brightness, such as diameter_error_mm (its size) or
        form_error_mm, as quality_COLUMN; repeat for more.
    better
        Which value of a target is better; known of the columns that exposight observe writes.
    seed
        Random seed, of the paper's models.
    restarts
        Starts of the optimiser, of the paper's models; the best is kept.
    workers
        Train this many of the paper's models in parallel; one for each core by default, at most 8.
    """
    chosen = (*DEFAULT_MODELS, *(each.name for each in MODELS)) if _ALL in names else names
    default = [name for name in DEFAULT_MODELS if name in chosen]
    specifications = [
        _specification(name) for name in dict.fromkeys(chosen) if name not in DEFAULT_MODELS
    ]
    if not default and (start_from is not None or mean is not None or target):
        msg = (
            f"--from, --mean and --target are of the default models, {' and '.join(DEFAULT_MODELS)}"
        )
        raise UsageError(msg)
    known = None if start_from is None else _window_model(start_from)
    observations, table, campaign_sensor, files = _observed(observations, output)
    trained_sensor, origin = _sensor(sensor, table, known, campaign_sensor)
    found = settle((*table.contradictions, _exposure_unit(table, trained_sensor)))
    make_folder(output, "the models")
    of_table: dict[str, Any] = {
        "source": observations.name,
        "source_sha256": table.sha256,
        "sensor": trained_sensor,
        "seed": seed,
    }
    models: list[Predictor] = []
    grazing = 0
    with progress_bars() as progress:
        if default:
            progress("training the default models", 0, 1)
            table, grazing = without_grazing(table)
            quality = train_window(
                table, mean=mean, start_from=known, progress=progress, **of_table
            )
            progress("training the default models", 1, 1)
            models += [each for each in (quality, quality.radiance) if each.name in default]
            models += [
                train_response(table, each, model=quality, better=better)
                for each in dict.fromkeys(target)
            ]
        for each in specifications:
            expected_s = Training(
                specification=each, table=table, seed=seed, restarts=restarts
            ).expected_s
            if expected_s > _WORTH_SAYING_S:
                progress.line(f"{each.name} takes about {number(expected_s, 2)} s of one core")
        if specifications:
            models += train_all(
                specifications,
                table,
                restarts=restarts,
                workers=workers or (1 if cluster.cluster else usual_workers()),
                cluster=cluster.chosen_cluster,
                progress=progress,
                **of_table,
            )
    for model in models:
        files.append(Written.at(output / f"{model.name}{MODEL_SUFFIX}", "model"))
        save_model(files[-1].path, model)
    facts = [fact("observations", str(observations))]
    tables = [_summary(models, files[-len(models) :])]
    if specifications:
        facts.append(fact("seed", seed))
    facts.append(fact("sensor", trained_sensor.name if trained_sensor else None, origin))
    if default:
        facts += model_facts(quality, table)
        tables.append(left_out_table(quality.radiance))
    if known is not None and keeps_limits(known.radiance, quality.sensor, quality.radiance.origin):
        low, high = known.limits
        text = (
            f"{number(low, 3)} and {number(high, 3)} grey levels, the sensor's limits of "
            f"{start_from}, but for a few percent; the surface was learnt anew"
        )
        facts.append(fact("kept", {"limits": [low, high]}, text))
    return Result(
        facts=tuple(facts),
        tables=(*tables, *map(_hyperparameters, models)),
        notes=(*_grazing_note(grazing), *_notes(table, models)),
        contradictions=found,
        files=tuple(files),
    )


def _grazing_note(n_rows: int) -> tuple[str, ...]:
    if not n_rows:
        return ()
    return (
        f"{counted(n_rows, 'row')} of rings seen at more than {GRAZING_DEG:g}° off their normal "
        "left out: a sensor measures nothing there",
    )


def _observed(
    source: Path, output: Path
) -> tuple[Path, ObservationTable, ActiveSensor | None, list[Written]]:
    """Return a table's file and rows; of a campaign, which is observed, its sensor and files."""
    if not (source / "campaign.json").is_file():
        return source, read_observations(source), None, []
    campaign = CampaignFolder(source)
    with progress_bars() as progress:
        table = observe_campaign(campaign, progress=progress)
    make_folder(output, "the models")
    file = Written.at(output / "observations.csv", "observations")
    table = replace(table, sha256=table.write(file.path), checked=True)
    return file.path, table, campaign.sensor, [file]


def _specification(name: str) -> ModelSpecification:
    """Return one of the paper's models; the error names the default ones, too."""
    known = [*DEFAULT_MODELS, *(each.name for each in MODELS), _ALL]
    if name not in known:
        msg = f"no model {name!r}; expected one of {', '.join(known)}" + did_you_mean(name, known)
        raise InputError(msg)
    return model_named(name)


def _sensor(
    given: str | None,
    table: ObservationTable,
    start_from: WindowModel | None,
    campaign: ActiveSensor | None,
) -> tuple[ActiveSensor | None, str]:
    """Return the sensor of a table's rows, and in words how it is known."""
    if given is not None:
        sensor = sensor_named_or_read(given)
        return sensor, sensor.name
    if start_from is not None and start_from.sensor is not None:
        return start_from.sensor, f"{start_from.sensor.name}, that of the model to start from"
    if campaign is not None:
        return campaign, f"{campaign.name}, that of the campaign"
    named = table.frame["sensor"].drop_nulls().unique().to_list()
    presets = [each for each in PRESETS.values() if each.name in named]
    if len(named) == len(presets) == 1:
        return presets[0], f"{presets[0].name}, the preset that the table names"
    if named:
        text = f"none: {', '.join(map(repr, named))} is no preset; give its file by --sensor"
        return None, text
    return None, "none: the table does not name it; give it by --sensor"


def _exposure_unit(table: ObservationTable, sensor: ActiveSensor | None) -> Contradiction | None:
    """Hold the exposure times that were taken, not emulated, against those of the sensor."""
    if sensor is None:
        return None
    taken = table.where(~table.frame["emulated"])
    limits = sensor.exposure
    return exposure_unit(taken.array(["exposure_ms"])[:, 0], (limits.min_ms, limits.max_ms))


def _window_model(path: Path) -> WindowModel:
    model = load_model(path)
    if not isinstance(model, WindowModel):
        msg = (
            f"{path}: --from takes the default quality model of the same sensor, got {model.name} "
            f"({model.title})"
        )
        raise InputError(msg)
    return model


def _notes(table: ObservationTable, models: Sequence[Predictor]) -> list[str]:
    """Return what of the table may not have been meant, and what of the fits may disappoint."""
    notes = list(table.remarks())
    for model in models:
        if isinstance(model, WindowModel | RadianceModel):
            notes += [note for note in model.notes if note not in notes]
            continue
        rows, wanted = model.n_observations or 0, _LEAST_ROWS * len(model.inputs)
        if rows < wanted:
            notes.append(
                f"{model.name} learnt from {counted(rows, 'row')} only; "
                f"{_LEAST_ROWS} for each of its inputs, {wanted}, are the least to expect much of"
            )
    if any(model.provenance.emulated for model in models):
        notes.append("emulated exposures are among the observations; the models' files say so")
    unfinished = [
        model.name
        for model in models
        if isinstance(model, GaussianProcessModel) and not model.summary.converged
    ]
    if unfinished:
        notes.append(f"{', '.join(unfinished)} did not converge; more --restarts may help")
    return notes


def _summary(models: Sequence[Predictor], files: Sequence[Written]) -> Table:
    fits = {
        each.name: {"experts": each.experts, **asdict(each.summary)}
        for each in models
        if isinstance(each, GaussianProcessModel)
    }
    nothing = dict.fromkeys(next(iter(fits.values()), {}))
    rows = [
        {
            "model": model.name,
            "title": model.title,
            "target": model.target,
            "inputs": model.inputs,
            "observations": model.n_observations,
            "emulated": model.provenance.emulated,
            **fits.get(model.name, nothing),
            "file": str(file.path),
        }
        for model, file in zip(models, files, strict=True)
    ]
    columns = (
        Column(name="model"),
        Column(name="title", label="predicts", wraps=True),
        Column(name="observations", label="rows"),
    )
    of_fits = (
        Column(name="log_marginal_likelihood", label="log\nlikelihood", digits=5),
        Column(name="converged"),
        Column(name="seconds", label="s", decimals=1),
    )
    return Table.of("models", rows, (*columns, *(of_fits if fits else ())))


def _hyperparameters(model: Predictor) -> Table:
    """Return a model's hyperparameters; those of the default models have been told in words."""
    table = hyperparameter_table(model)
    told = isinstance(model, WindowModel | RadianceModel)
    return replace(table, shown_rows=0) if told else table
