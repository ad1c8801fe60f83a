"""Scores: every trained variant evaluated on every set of rows that the paper uses."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from exposight.errors import ObservationError
from exposight.models import GaussianProcessModel, ModelSpecification, Predictor, evaluate
from exposight.observing import ObservationTable
from exposight.paper.datasets import Dataset, inside_range
from exposight.paper.results import LearningCurve, LearningStep, Score, TrainedVariant
from exposight.paper.variants import EvaluationRole, EvaluationSet, Variant


def score_variant(
    variant: Variant,
    model: Predictor,
    datasets: Mapping[str, Dataset],
    *,
    train_by_view: Callable[[ObservationTable], Predictor],
) -> tuple[Score, ...]:
    """Evaluate a trained variant on all its sets of rows.

    Parameters
    ----------
    variant : Variant
        Its definition.
    model : Predictor
        Trained on ``datasets[variant.dataset].train``.
    datasets : mapping of str to Dataset
        All datasets by name.
    train_by_view : callable
        Trains one like it on the rows of other views. A Gaussian process's `with_training_rows`
        will do: other rows change what it knows; its few hyperparameters, fitted to a thousand rows
        of the same kind, would stay nearly the same.

    Returns
    -------
    tuple of Score
        In the order of ``variant.evaluations``.
    """
    dataset = datasets[variant.dataset]
    train = trained_side(dataset)
    by_view: Predictor | None = None
    scores = []
    for line in variant.evaluations:
        judged = model
        if line.role == "validation_by_view":
            by_view = by_view or train_by_view(_side(dataset.train_by_view, dataset))
            judged = by_view
        scores.append(score_on(line, variant.specification, judged, _rows(line, datasets, train)))
    return tuple(scores)


def score_on(
    line: EvaluationSet,
    specification: ModelSpecification,
    model: Predictor,
    rows: ObservationTable,
) -> Score:
    """Evaluate a model on those rows that a specification learns from, if any is left."""
    usable = model.rows(specification.rows(rows))
    return Score(evaluation=line, result=evaluate(model, usable) if len(usable) else None)


def learning_curve(
    trained: TrainedVariant, role: EvaluationRole, fewer: Sequence[GaussianProcessModel]
) -> LearningCurve | None:
    """Evaluate models of one variant that were trained on fewer rows, and the one of all.

    Parameters
    ----------
    trained : TrainedVariant
        Trained on all rows.
    role : {'test', 'test_inside'}
        Rows that evaluate every model: those of its score with this role.
    fewer : sequence of GaussianProcessModel
        By growing number of training rows.

    Returns
    -------
    LearningCurve or None
        None where there is no row to evaluate on.
    """
    line = next(score for score in trained.scores if score.evaluation.role == role)
    if line.result is None:
        return None
    form = trained.variant.specification
    steps = [
        LearningStep(n_train=model.n_observations, score=score)
        for model in (*fewer, trained.model)
        if (score := score_on(line.evaluation, form, model, line.result.table).score) is not None
    ]
    return LearningCurve(
        variant=trained.variant.name,
        dataset=line.evaluation.dataset,
        role=line.evaluation.role,
        steps=tuple(steps),
    )


def _rows(
    line: EvaluationSet, datasets: Mapping[str, Dataset], train: ObservationTable
) -> ObservationTable:
    dataset = datasets[line.dataset]
    match line.role:
        case "validation":
            return _side(dataset.validation, dataset)
        case "validation_by_view":
            return _side(dataset.validation_by_view, dataset)
        case _:
            table = dataset.table
    if line.features:
        table = table.where(np.isin(table.names("feature"), line.features))
    if line.inside and len(table):
        table = table.where(inside_range(train, table, line.inside))
    return table


def trained_side(dataset: Dataset) -> ObservationTable:
    """Return the side of a dataset's random split that trains; `ObservationError` without one."""
    return _side(dataset.train, dataset)


def _side(table: ObservationTable | None, dataset: Dataset) -> ObservationTable:
    """Return one side of a dataset's split, which it must have."""
    if table is None:
        msg = (
            f"dataset {dataset.name!r} is not split, since it has {len(dataset.table)} "
            "observations; nothing can learn from it"
        )
        raise ObservationError(msg)
    return table
