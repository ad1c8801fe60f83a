"""Scores: every trained variant evaluated on every set of rows that the paper uses."""

from collections.abc import Mapping, Sequence

import numpy as np

from exposight.errors import ObservationError
from exposight.models import GaussianProcessModel, evaluate
from exposight.observing import ObservationTable
from exposight.paper.datasets import Dataset, inside_range
from exposight.paper.results import LearningCurve, LearningStep, Score, TrainedVariant
from exposight.paper.variants import EvaluationRole, EvaluationSet, Variant


def score_variant(
    variant: Variant, model: GaussianProcessModel, datasets: Mapping[str, Dataset]
) -> tuple[Score, ...]:
    """Evaluate a trained variant on all its sets of rows.

    Parameters
    ----------
    variant : Variant
        Its definition.
    model : GaussianProcessModel
        Trained on ``datasets[variant.dataset].train``.
    datasets : mapping of str to Dataset
        All datasets by name.

    Returns
    -------
    tuple of Score
        In the order of ``variant.evaluations``.
    """
    dataset = datasets[variant.dataset]
    train = _side(dataset.train, dataset)
    by_view: GaussianProcessModel | None = None
    scores = []
    for line in variant.evaluations:
        judged = model
        if line.role == "validation_by_view":
            # Other training rows change what a model knows; its few hyperparameters, fitted to a
            # thousand rows of the same kind, would stay nearly the same.
            rows = _side(dataset.train_by_view, dataset)
            by_view = by_view or model.with_training_rows(rows)
            judged = by_view
        scores.append(score_on(line, judged, _rows(line, datasets, train)))
    return tuple(scores)


def score_on(line: EvaluationSet, model: GaussianProcessModel, rows: ObservationTable) -> Score:
    """Evaluate a model on rows of its own kind (`ModelSpecification.rows`), if any is left."""
    usable = len(model.specification.rows(rows)) > 0
    return Score(evaluation=line, result=evaluate(model, rows) if usable else None)


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
    steps = [
        LearningStep(n_train=model.n_observations, score=score)
        for model in (*fewer, trained.model)
        if (score := score_on(line.evaluation, model, line.result.table).score) is not None
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


def _side(table: ObservationTable | None, dataset: Dataset) -> ObservationTable:
    """Return one side of a dataset's split, which it must have."""
    if table is None:
        msg = (
            f"dataset {dataset.name!r} is not split, since it has {len(dataset.table)} "
            "observations; nothing can learn from it"
        )
        raise ObservationError(msg)
    return table
