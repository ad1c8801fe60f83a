"""The whole study: measure, train, evaluate. Every dataset and model is kept as soon as it is done.

::

    FOLDER/
      observations/   a table for each campaign
      models/         a file for each trained model

Both are named by checksums of what they were made from, so running again uses what is there, and a
changed setting makes only what it changes.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl

from exposight import __version__
from exposight.cell import ActiveSensor
from exposight.errors import InputError
from exposight.files import make_folder
from exposight.models import GaussianProcessModel, ModelSpecification, Predictor, Training
from exposight.observing import ObservationTable
from exposight.paper.campaigns import CAMPAIGNS, ObservedCampaign, collect
from exposight.paper.datasets import DATASETS, Dataset, build_dataset
from exposight.paper.findings import judge
from exposight.paper.kept_models import table_checksum, train_or_read
from exposight.paper.results import DependenceMatrix, LearningCurve, StudyResult, TrainedVariant
from exposight.paper.scores import learning_curve, score_variant, trained_side
from exposight.paper.study_settings import SensorKind, StudySettings
from exposight.paper.study_tables import score_row, study_tables
from exposight.paper.variants import LEARNING_CURVES, VARIANTS, Variant
from exposight.statistics import maximal_information_matrix
from exposight.workers import Progress, ignore_progress

DEPENDENCE_COLUMNS: Final = (
    "p_norm",
    "exposure_ms",
    "i_avg",
    "x_mm",
    "y_mm",
    "z_mm",
    "w_deg",
    "p_deg",
    "radius_mm",
)
"""Variables of Fig. 20, but r, which is 0."""

_LEARNING_DIVISORS: Final = (16, 8, 4, 2)
"""Fractions of the training rows on Figs. 22 and 23, before all."""

_RESTARTS, _QUICK_RESTARTS = 3, 1
"""Starts of a fit; the paper took three (Sect. 3.3.4)."""

_DEPENDENCE_ROWS = 1000
"""Rows of which coefficients are computed, drawn evenly where there are more, as time grows with
their square; about as many as the paper's 912."""


def run_study(
    folder: Path,
    settings: StudySettings | None = None,
    progress: Progress = ignore_progress,
) -> StudyResult:
    """Carry out the paper's study; resume an interrupted run.

    Parameters
    ----------
    folder : Path
        Where observations and models are kept; made if it does not exist.
    settings : StudySettings, optional
        Which sensors, quick or in full, simulated or recorded, seed, workers.
    progress : Progress
        Receives captures measured, models trained and evaluated, coefficients computed.

    Returns
    -------
    StudyResult
        The same for the same settings, whatever was kept before and however many workers.

    Raises
    ------
    ExposightError
        As for `collect` and `train_or_read`: a missing or unfit recorded campaign, too few
        observations, a full disk.
    """
    settings = settings or StudySettings()
    observations, models = (
        make_folder(Path(folder) / "observations"),
        make_folder(Path(folder) / "models"),
    )
    observed = {
        campaign.name: measured
        for campaign in CAMPAIGNS
        if campaign.sensor in settings.sensors
        and (measured := collect(campaign, observations, settings, progress)) is not None
    }
    tables = {name: measured.table for name, measured in observed.items()}
    datasets = {
        definition.name: build_dataset(definition, tables, settings)
        for definition in DATASETS
        if definition.sensor in settings.sensors
    }
    trained, curves = _train(datasets, _sensors(observed), models, settings, progress)
    result = StudyResult(
        settings=settings,
        exposight_version=__version__,
        campaigns=tuple(measured.description for measured in observed.values()),
        datasets=tuple(datasets.values()),
        variants=trained,
        tables=study_tables(datasets.values(), trained),
        dependence=_dependence(datasets, settings, progress),
        learning_curves=curves,
    )
    return replace(result, findings=judge(result))


def add_to_study(
    study: StudyResult,
    model: ModelSpecification | Callable[[ObservationTable], Predictor],
    *,
    beside: str,
) -> StudyResult:
    """Train a further predictor on the rows of one of the paper's, and add it to the tables.

    Parameters
    ----------
    study : StudyResult
        What `run_study` returned.
    model : ModelSpecification or callable
        A Gaussian process, trained as the paper's are; or a function that trains a predictor of any
        kind on a table. It is given the training rows alone.
    beside : str
        The paper's model (`VARIANTS`) whose rows it learns from and is evaluated on: ``e_k6``.

    Returns
    -------
    StudyResult
        Its lines are the last of ``tables.scores``' tables, and so of the page and the CSV files;
        all else stays.

    Raises
    ------
    InputError
        If the study has no such model, the predictor has another target, or its name is taken.
    ExposightError
        As for `Training.run` or the function.
    """
    paper = study.variant(beside)
    variant, datasets = paper.variant, {dataset.name: dataset for dataset in study.datasets}
    rows = trained_side(datasets[variant.dataset])

    def train(rows: ObservationTable) -> Predictor:
        if not isinstance(model, ModelSpecification):
            return model(rows)
        form = replace(variant, specification=model)
        return _training(form, rows, paper.model.sensor, study.settings).run()

    if isinstance(model, ModelSpecification):
        _check_further(study, variant, model)
    predictor = train(rows)
    _check_further(study, variant, predictor)
    named = replace(variant, name=predictor.name, title=predictor.title)
    by_view: Callable[[ObservationTable], Predictor] = train
    if isinstance(predictor, GaussianProcessModel):  # as the paper's are trained there
        by_view = predictor.with_training_rows
    scores = score_variant(named, predictor, datasets, train_by_view=by_view)
    lines = pl.DataFrame(
        [score_row(named, len(rows), score) for score in scores], infer_schema_length=None
    )
    table = pl.concat([study.tables.scores, lines], how="vertical_relaxed")
    table = table.sort("table", maintain_order=True)
    return replace(study, tables=replace(study.tables, scores=table))


def _check_further(
    study: StudyResult, variant: Variant, model: ModelSpecification | Predictor
) -> None:
    """Check that a predictor can stand in the tables beside one of the paper's."""
    taken = study.tables.scores["variant"].unique(maintain_order=True).to_list()
    if model.target == variant.specification.target and model.name not in taken:
        return
    msg = (
        f"a model beside {variant.name} predicts {variant.specification.target} and has a name "
        f"that is not taken, got {model.name!r}, which predicts {model.target}; taken are "
        f"{', '.join(taken)}"
    )
    raise InputError(msg)


def _sensors(observed: Mapping[str, ObservedCampaign]) -> dict[SensorKind, ActiveSensor]:
    """Return the sensor of each kind, that of the required campaign."""
    return {
        item.campaign.sensor: item.sensor for item in observed.values() if item.campaign.required
    }


def _train(
    datasets: Mapping[str, Dataset],
    sensors: Mapping[SensorKind, ActiveSensor],
    folder: Path,
    settings: StudySettings,
    progress: Progress,
) -> tuple[tuple[TrainedVariant, ...], tuple[LearningCurve, ...]]:
    """Train the variants, and some of them on fewer rows, all in one go so that no worker waits."""
    full = {
        variant: _training(variant, rows, sensors[variant.sensor], settings)
        for variant in VARIANTS
        if variant.dataset in datasets and (rows := datasets[variant.dataset].train) is not None
    }
    fewer = {
        variant: tuple(_fewer(full[variant], divisor, settings) for divisor in _LEARNING_DIVISORS)
        for variant in full
        if variant.name in LEARNING_CURVES
    }
    trainings = (*full.values(), *(item for steps in fewer.values() for item in steps))
    trained_models = train_or_read(trainings, folder, workers=settings.workers, progress=progress)
    models = dict(zip(map(id, trainings), trained_models, strict=True))
    trained, curves = [], []
    for done, (variant, training) in enumerate(full.items()):
        progress("evaluating models", done, len(full))
        model = models[id(training)]
        scores = score_variant(variant, model, datasets, train_by_view=model.with_training_rows)
        trained.append(TrainedVariant(variant=variant, model=model, scores=scores))
        steps = [models[id(step)] for step in fewer.get(variant, ())]
        if steps and (curve := learning_curve(trained[-1], LEARNING_CURVES[variant.name], steps)):
            curves.append(curve)
    progress("evaluating models", len(full), len(full))
    return tuple(trained), tuple(curves)


def _training(
    variant: Variant, rows: ObservationTable, sensor: ActiveSensor | None, settings: StudySettings
) -> Training:
    return Training(
        specification=variant.specification,
        table=rows,
        source=f"the study's dataset {variant.dataset}, training side",
        source_sha256=table_checksum(rows),
        sensor=sensor,
        seed=settings.seed,
        restarts=_QUICK_RESTARTS if settings.quick else _RESTARTS,
        committee_rows=None,  # the paper's processes are exact
    )


def _fewer(training: Training, divisor: int, settings: StudySettings) -> Training:
    """Return a training on a fraction of the rows; smaller fractions lie within larger ones."""
    rows = training.table
    order = np.random.default_rng([settings.seed, len(rows)]).permutation(len(rows))
    chosen = np.sort(order[: len(rows) // divisor])
    fewer = ObservationTable(frame=rows.frame[chosen])
    return replace(
        training,
        table=fewer,
        source_sha256=table_checksum(fewer),
        source=f"{training.source}, one row in {divisor}",
    )


def _dependence(
    datasets: Mapping[str, Dataset], settings: StudySettings, progress: Progress
) -> tuple[DependenceMatrix, ...]:
    matrices = []
    for name in ("X", "s2_X"):
        table = datasets[name].train if name in datasets else None
        if table is None:
            continue
        if len(table) > _DEPENDENCE_ROWS:
            every = np.linspace(0, len(table) - 1, _DEPENDENCE_ROWS).round().astype(np.intp)
            table = ObservationTable(frame=table.frame[every])
        values = maximal_information_matrix(
            table.array(DEPENDENCE_COLUMNS),
            threads=settings.workers,
            progress=lambda _, done, n, name=name: progress(f"dependence in {name}", done, n),
        )
        matrices.append(DependenceMatrix(dataset=name, columns=DEPENDENCE_COLUMNS, values=values))
    return tuple(matrices)
