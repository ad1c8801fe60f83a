"""Trained variants held against every set of rows that the paper judges them by."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from exposight.errors import ObservationError
from exposight.models import Evaluation, GaussianProcessModel, evaluate
from exposight.paper.datasets import inside_range
from exposight.paper.results import Score

if TYPE_CHECKING:
    from collections.abc import Mapping

    from exposight.observing import ObservationTable
    from exposight.paper.results import Dataset, EvaluationSet, Variant


def score_variant(
    variant: Variant, model: GaussianProcessModel, datasets: Mapping[str, Dataset]
) -> tuple[Score, ...]:
    """Judge a trained variant by all its lines.

    Parameters
    ----------
    variant : Variant
        What it is.
    model : GaussianProcessModel
        Trained on ``datasets[variant.dataset].train``.
    datasets : mapping of str to Dataset
        All datasets by name.

    Returns
    -------
    tuple of Score
        In the order of ``variant.evaluations``.
    """
    own = datasets[variant.dataset]
    train = _known(own.train, own)
    by_view: GaussianProcessModel | None = None
    scores = []
    for line in variant.evaluations:
        judged = model
        if line.role == "validation_by_view":
            if by_view is None:
                by_view = reconditioned(model, _known(own.train_by_view, own))
            judged = by_view
        rows = _rows(line, datasets, train)
        scores.append(score_on(variant.name, line, judged, rows))
    return tuple(scores)


def score_on(
    variant: str, line: EvaluationSet, model: GaussianProcessModel, rows: ObservationTable
) -> Score:
    """Judge a model by rows.

    Parameters
    ----------
    variant : str
        Its name.
    line : EvaluationSet
        What the rows are.
    model : GaussianProcessModel
        To be judged.
    rows : ObservationTable
        Of them, those that are of the model's kind are used (`ModelSpecification.rows`).

    Returns
    -------
    Score
        Without figures where no row is left.
    """
    if len(model.specification.rows(rows)) == 0:
        return Score(
            variant=variant, evaluation=line, result=None, score=None, relative_error_percent=None
        )
    result = evaluate(model, rows)
    return Score(
        variant=variant,
        evaluation=line,
        result=result,
        score=result.score,
        relative_error_percent=_relative_error_percent(result),
    )


def reconditioned(model: GaussianProcessModel, rows: ObservationTable) -> GaussianProcessModel:
    """Return a model with the same hyperparameters that has learnt from other rows.

    Used for the split by view: which rows train changes what a model knows, while the handful of
    hyperparameters, found from a thousand rows of the same kind, stay nearly the same.

    Parameters
    ----------
    model : GaussianProcessModel
        Whose hyperparameters to take.
    rows : ObservationTable
        To learn from.
    """
    return model.with_training_rows(rows)


def _rows(
    line: EvaluationSet, datasets: Mapping[str, Dataset], train: ObservationTable
) -> ObservationTable:
    dataset = datasets[line.dataset]
    match line.role:
        case "validation":
            return _known(dataset.validation, dataset)
        case "validation_by_view":
            return _known(dataset.validation_by_view, dataset)
        case _:
            table = dataset.table
    if line.features:
        table = table.where(np.isin(table.names("feature"), line.features))
    if line.inside and len(table):
        table = table.where(inside_range(train, table, line.inside))
    return table


def _known(table: ObservationTable | None, dataset: Dataset) -> ObservationTable:
    if table is None:
        msg = (
            f"dataset {dataset.name!r} is not split, since it has {len(dataset.table)} "
            "observations; nothing can learn from it"
        )
        raise ObservationError(msg)
    return table


def _relative_error_percent(result: Evaluation) -> float | None:
    """Mean of |predicted − true| / true in percent, for exposure times, which are above 0."""
    if result.model.target != "exposure_ms":
        return None
    error = np.abs(result.prediction.mean - result.observed) / result.observed
    return float(100.0 * error.mean())
