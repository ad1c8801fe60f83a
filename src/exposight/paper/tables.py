"""Tables 2, 3, 4, 5, 6, 8 and 9 of the paper: ours, the paper's, and the difference."""

from __future__ import annotations

import io
import math
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from exposight.gp import gpy_length_scale
from exposight.observing import ObservationTable
from exposight.paper.published import (
    RANGES,
    published_datasets,
    published_hyperparameters,
    published_scores,
)
from exposight.paper.result import (
    Dataset,
    DatasetRow,
    HyperparameterRow,
    ScoreRow,
    StudyTables,
    TrainedRung,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from exposight.gp import Parameter
    from exposight.models import TrainedModel
    from exposight.paper.result import Score


_SYMBOLS = {
    "variance": "σ²",
    "length_scale": "ℓ",
    "alpha": "α",
    "slope_variance": "σ²",
    "noise_variance": "ε",
}
_UNITS = {"mm": "mm", "deg": "°", "avg": ""}  # by the end of a column's name

_PLANES = (("near", -math.inf, -85.0), ("middle", -85.0, 75.0), ("far", 75.0, math.inf))
"""Depth planes of X in z_mm, cut midway between Table 9's ranges."""


def build_tables(datasets: Sequence[Dataset], rungs: Sequence[TrainedRung]) -> StudyTables:
    """Return all tables.

    Parameters
    ----------
    datasets : sequence of Dataset
        For Table 9, in its order.
    rungs : sequence of TrainedRung
        For the others, in their order.
    """
    return StudyTables(
        scores=score_rows(rungs),
        hyperparameters=tuple(row for rung in rungs for row in hyperparameter_rows(rung)),
        datasets=tuple(row for dataset in datasets for row in dataset_rows(dataset)),
    )


def score_rows(rungs: Sequence[TrainedRung]) -> tuple[ScoreRow, ...]:
    """Return Tables 2 to 6, one after the other."""
    rows = [_score_row(trained, score) for trained in rungs for score in trained.scores]
    return tuple(sorted(rows, key=lambda row: row.table))  # sorting keeps the order within each


def _score_row(trained: TrainedRung, score: Score) -> ScoreRow:
    rung, line, own = trained.rung, score.evaluation, score.score
    paper = published_scores().get((rung.name, line.paper_dataset, line.paper_features))
    full_scale = 100.0 if rung.unit == "%" else 1.0  # p_norm is tabulated in percent
    r2 = None if own is None or math.isnan(own.r2_percent) else own.r2_percent
    rmse = None if own is None else full_scale * own.rmse
    return ScoreRow(
        table=line.table,
        rung=rung.name,
        rung_title=rung.title,
        trained_on=rung.dataset,
        n_train=len(trained.model.process.y),
        dataset=line.paper_dataset,
        role=line.role,
        features=line.paper_features,
        n=0 if own is None else own.n,
        unit=rung.unit,
        r2_percent=r2,
        mse=None if own is None else own.mse,
        rmse=rmse,
        mae=None if own is None else full_scale * own.mae,
        relative_error_percent=score.relative_error_percent,
        coverage_1sigma_percent=_percent(own.coverage_1sigma if own else None),
        coverage_2sigma_percent=_percent(own.coverage_2sigma if own else None),
        paper_r2_percent=paper.r2_percent if paper else None,
        paper_mse=paper.mse if paper else None,
        paper_rmse=paper.rmse if paper else None,
        r2_difference=r2 - paper.r2_percent if paper and r2 is not None else None,
        rmse_difference=rmse - paper.rmse if paper and rmse is not None else None,
    )


def _percent(share: float | None) -> float | None:
    return None if share is None else 100.0 * share


def hyperparameter_rows(trained: TrainedRung) -> tuple[HyperparameterRow, ...]:
    """Return a rung's lines of Table 8, the noise variance last.

    Length scales of rational quadratic kernels are GPy's, ℓ √α, as in the paper.
    """
    model, rung = trained.model, trained.rung
    alpha = next(
        (own.value for own in model.process.kernel.parameters if own.quantity == "alpha"), None
    )
    rows = [
        _hyperparameter_row(rung.name, own, model, alpha)
        for own in model.process.kernel.parameters
        if own.free
    ]
    target = "ms" if rung.unit == "ms" else ""
    noise = HyperparameterRow(
        rung=rung.name,
        parameter="noise_variance",
        symbol=_SYMBOLS["noise_variance"],
        input="",
        unit=f"{target}²" if target else "",
        value=model.process.noise_variance,
        paper_value=published_hyperparameters().get((rung.name, "noise_variance", "")),
        at_bound="noise_variance" in model.summary.parameters_at_bound,
    )
    return (*rows, noise)


def _hyperparameter_row(
    rung: str, own: Parameter, model: TrainedModel, alpha: float | None
) -> HyperparameterRow:
    quantity = own.quantity.value
    inputs = model.specification.inputs
    target = "ms" if model.specification.target == "exposure_ms" else ""
    name, unit, value = "", "", own.value
    if quantity in {"length_scale", "slope_variance"}:
        name = inputs[own.dims[0]] if len(own.dims) == 1 else "all"
        # One length scale of several inputs serves mm, degrees and grey levels at once.
        unit = "mixed" if name == "all" else _UNITS[name.rsplit("_", 1)[1]]
    match quantity:
        case "length_scale" if alpha is not None:
            value = gpy_length_scale(own.value, alpha=alpha)
        case "variance":
            unit = f"{target}²" if target else ""
        case "slope_variance":
            unit = f"(ms/{unit})²" if unit else "ms²"
    return HyperparameterRow(
        rung=rung,
        parameter=quantity,
        symbol=_SYMBOLS[quantity],
        input=name,
        unit=unit,
        value=value,
        paper_value=published_hyperparameters().get((rung, quantity, name)),
        at_bound=own.name in model.summary.parameters_at_bound,
    )


def dataset_rows(dataset: Dataset) -> tuple[DatasetRow, ...]:
    """Return a dataset's lines of Table 9: for X its three depth planes, then all of it."""
    table = dataset.table
    rows = []
    if dataset.name == "X":
        z_mm = table.array(["z_mm"])[:, 0]
        rows = [
            _dataset_row(dataset, f"X {name}", table.where((z_mm >= low) & (z_mm < high)))
            for name, low, high in _PLANES
        ]
    own = _dataset_row(
        dataset,
        dataset.name,
        table,
        n_train=None if dataset.train is None else len(dataset.train),
        n_validation=None if dataset.validation is None else len(dataset.validation),
    )
    return (*rows, own)


def _dataset_row(
    dataset: Dataset,
    name: str,
    table: ObservationTable,
    *,
    n_train: int | None = None,
    n_validation: int | None = None,
) -> DatasetRow:
    paper = published_datasets()[name]
    ranges = {column: _range(table, column) for column in RANGES}
    paper_ranges = {f"paper_{column}": paper.ranges.get(column) for column in RANGES}
    return DatasetRow(
        dataset=name,
        sensor=dataset.sensor,
        features=paper.features,
        n=len(table),
        n_train=n_train,
        n_validation=n_validation,
        n_features=len(set(table.names("feature"))),
        n_views=len(set(table.names("view"))),
        paper_n=paper.n,
        paper_n_train=paper.n_train,
        **ranges,
        **paper_ranges,
    )


def _range(table: ObservationTable, column: str) -> tuple[float, float] | None:
    if len(table) == 0:
        return None
    values = table.array([column])
    return float(np.min(values)), float(np.max(values))


def table_csv(rows: Sequence[ScoreRow | HyperparameterRow | DatasetRow]) -> bytes:
    """Return rows of one kind as CSV with a header; ranges become two columns, low and high.

    Numbers are written so that reading them gives the same ones; what there is not is empty.
    """
    records = [_flat(asdict(row)) for row in rows]
    names = list(dict.fromkeys(name for record in records for name in record))
    columns = {name: [record.get(name) for record in records] for name in names}
    buffer = io.BytesIO()
    pl.DataFrame(columns, strict=False).write_csv(buffer)
    return buffer.getvalue()


def _flat(record: dict[str, object]) -> dict[str, object]:
    flat: dict[str, object] = {}
    for name, value in record.items():
        if name.removeprefix("paper_") in RANGES:
            low, high = value if isinstance(value, tuple) else (None, None)
            flat |= {f"{name}_low": low, f"{name}_high": high}
        else:
            flat[name] = value
    return flat
