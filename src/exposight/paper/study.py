"""The whole study: measure, train, judge. Every dataset and model is kept as soon as it is done.

::

    FOLDER/
      observations/   a table for each campaign
      models/         a file for each trained model

Both are named by checksums of what they were made from, so running again uses what is there, and a
changed setting makes only what it changes.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from exposight import __version__
from exposight.errors import FileError
from exposight.observing import ObservationTable
from exposight.paper.campaigns import CAMPAIGNS, ObservedCampaign, collect
from exposight.paper.datasets import DATASETS, build_dataset
from exposight.paper.findings import judge
from exposight.paper.results import (
    Dataset,
    DependenceMatrix,
    LearningCurve,
    LearningStep,
    SensorKind,
    StudyResult,
    StudySettings,
    TrainedVariant,
    Variant,
)
from exposight.paper.scores import score_on, score_variant
from exposight.paper.special_findings import Evidence
from exposight.paper.tables import build_tables
from exposight.paper.training import KeptTraining, table_checksum, train_or_read
from exposight.paper.variants import LEARNING_CURVES, VARIANTS
from exposight.statistics import maximal_information_matrix

if TYPE_CHECKING:
    from collections.abc import Mapping

    from exposight.cell import ActiveSensor
    from exposight.models import GaussianProcessModel
    from exposight.workers import Progress


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
    folder: Path, settings: StudySettings | None = None, progress: Progress | None = None
) -> StudyResult:
    """Carry out the paper's study; go on where an earlier run stopped.

    Parameters
    ----------
    folder : Path
        Where observations and models are kept; made if it is not there.
    settings : StudySettings, optional
        Which sensors, quick or in full, simulated or recorded, seed, workers.
    progress : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    StudyResult
        The same for the same settings, whatever was kept before and however many workers.

    Raises
    ------
    ExposightError
        As for `collect` and `train_all`: a missing or unfit recorded campaign, too few
        observations, a full disk.
    """
    settings = settings or StudySettings()
    tell = progress or _silent
    observations, models = _make_folders(Path(folder))
    observed = _measure(observations, settings, tell)
    datasets = {
        own.name: build_dataset(own, {k: o.table for k, o in observed.items()}, settings)
        for own in DATASETS
        if own.sensor in settings.sensors
    }
    variants = tuple(variant for variant in VARIANTS if _can_learn(datasets.get(variant.dataset)))
    sensors = {o.campaign.sensor: o.sensor for o in observed.values() if o.campaign.required}
    trained, curves = _train(variants, datasets, sensors, models, settings, tell)
    tables = build_tables(tuple(datasets.values()), trained)
    dependence = _dependence(datasets, settings, tell)
    evidence = Evidence(
        datasets=datasets,
        variants={own.variant.name: own for own in trained},
        dependence={datasets[own.dataset].sensor: own for own in dependence},
        learning={curve.variant: curve for curve in curves},
    )
    return StudyResult(
        settings=settings,
        exposight_version=__version__,
        campaigns=tuple(own.description for own in observed.values()),
        datasets=tuple(datasets.values()),
        variants=trained,
        tables=tables,
        dependence=dependence,
        learning_curves=curves,
        findings=judge(
            tables.scores, evidence, settings.sensors, simulated=settings.campaigns is None
        ),
    )


def _silent(stage: str, done: int, total: int) -> None:
    """Tell nobody how far work is."""


def _make_folders(folder: Path) -> tuple[Path, Path]:
    folders = folder / "observations", folder / "models"
    for own in folders:
        try:
            own.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            msg = f"{own} cannot be used for output: {error.strerror or error}"
            raise FileError(msg) from error
    return folders


def _measure(folder: Path, settings: StudySettings, tell: Progress) -> dict[str, ObservedCampaign]:
    observed = {}
    for campaign in CAMPAIGNS:
        if campaign.sensor not in settings.sensors:
            continue
        own = collect(campaign, folder, settings, partial(tell, f"measuring {campaign.name}"))
        if own is not None:
            observed[campaign.name] = own
    return observed


def _can_learn(dataset: Dataset | None) -> bool:
    return dataset is not None and dataset.train is not None


def _train(
    variants: tuple[Variant, ...],
    datasets: Mapping[str, Dataset],
    sensors: Mapping[SensorKind, ActiveSensor],
    folder: Path,
    settings: StudySettings,
    tell: Progress,
) -> tuple[tuple[TrainedVariant, ...], tuple[LearningCurve, ...]]:
    """Train the variants, and some of them on fewer rows, all in one go so that no worker waits."""
    full = {variant.name: _training(variant, datasets, sensors, settings) for variant in variants}
    fewer = {
        name: tuple(_fewer(full[name], divisor, settings) for divisor in _LEARNING_DIVISORS)
        for name, _ in LEARNING_CURVES
        if name in full
    }
    trainings = (*full.values(), *(own for steps in fewer.values() for own in steps))
    models = train_or_read(
        trainings,
        folder,
        workers=settings.workers,
        progress=tell,
    )
    by_training = dict(zip(map(id, trainings), models, strict=True))
    trained = []
    for done, variant in enumerate(variants):
        tell("judging models", done, len(variants))
        model = by_training[id(full[variant.name])]
        trained.append(
            TrainedVariant(
                variant=variant,
                model=model,
                path=full[variant.name].path(folder),
                scores=score_variant(variant, model, datasets),
            )
        )
    tell("judging models", len(variants), len(variants))
    curves = [
        _learning_curve(
            next(own for own in trained if own.variant.name == name),
            role,
            [by_training[id(own)] for own in fewer[name]],
        )
        for name, role in LEARNING_CURVES
        if name in full
    ]
    return tuple(trained), tuple(curve for curve in curves if curve.steps)


def _training(
    variant: Variant,
    datasets: Mapping[str, Dataset],
    sensors: Mapping[SensorKind, ActiveSensor],
    settings: StudySettings,
) -> KeptTraining:
    dataset = datasets[variant.dataset]
    rows = dataset.train if dataset.train is not None else dataset.table
    return KeptTraining(
        name=variant.name,
        specification=variant.specification,
        table=rows,
        source=f"the study's dataset {variant.dataset}, training side",
        source_sha256=table_checksum(rows),
        sensor=sensors[variant.sensor],
        seed=settings.seed,
        restarts=_QUICK_RESTARTS if settings.quick else _RESTARTS,
        committee_rows=None,  # the paper's processes are exact
    )


def _fewer(training: KeptTraining, divisor: int, settings: StudySettings) -> KeptTraining:
    """Return a training on a fraction of the rows; smaller fractions lie within larger ones."""
    rows = training.table
    order = np.random.default_rng([settings.seed, len(rows)]).permutation(len(rows))
    chosen = np.sort(order[: len(rows) // divisor])
    fewer = ObservationTable(frame=rows.frame[chosen])
    return replace(
        training,
        name=f"{training.name}-{divisor}th",
        table=fewer,
        source_sha256=table_checksum(fewer),
        source=f"{training.source}, one row in {divisor}",
    )


def _learning_curve(
    trained: TrainedVariant, role: str, models: list[GaussianProcessModel]
) -> LearningCurve:
    whole = next(own for own in trained.scores if own.evaluation.role == role)
    steps = []
    if whole.result is not None and whole.score is not None:
        for model in models:
            score = score_on(
                trained.variant.name, whole.evaluation, model, whole.result.table
            ).score
            if score is not None:
                steps.append(LearningStep(n_train=model.n_observations, score=score))
        steps.append(LearningStep(n_train=trained.model.n_observations, score=whole.score))
    return LearningCurve(
        variant=trained.variant.name,
        dataset=whole.evaluation.dataset,
        role=whole.evaluation.role,
        steps=tuple(steps),
    )


def _dependence(
    datasets: Mapping[str, Dataset], settings: StudySettings, tell: Progress
) -> tuple[DependenceMatrix, ...]:
    matrices = []
    for name in ("X", "s2_X"):
        dataset = datasets.get(name)
        if dataset is None or dataset.train is None:
            continue
        table = dataset.train
        if len(table) > _DEPENDENCE_ROWS:
            every = np.linspace(0, len(table) - 1, _DEPENDENCE_ROWS).round().astype(np.intp)
            table = ObservationTable(frame=table.frame[every])
        values = maximal_information_matrix(
            table.array(DEPENDENCE_COLUMNS),
            threads=settings.workers,
            progress=lambda _, done, n, name=name: tell(f"dependence in {name}", done, n),
        )
        matrices.append(DependenceMatrix(dataset=name, columns=DEPENDENCE_COLUMNS, values=values))
    return tuple(matrices)
