"""Tables 2, 3, 4, 5, 6, 8 and 9 of the paper: ours, the paper's, and the difference."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import asdict, dataclass
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from exposight.gp import gpy_length_scale
from exposight.observing import ObservationTable
from exposight.paper.results import (
    Dataset,
    DatasetRow,
    HyperparameterRow,
    ScoreRow,
    StudyTables,
    TrainedVariant,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from exposight.models import GaussianProcessModel, Hyperparameter
    from exposight.paper.results import Score


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


def build_tables(datasets: Sequence[Dataset], variants: Sequence[TrainedVariant]) -> StudyTables:
    """Return all tables.

    Parameters
    ----------
    datasets : sequence of Dataset
        For Table 9, in its order.
    variants : sequence of TrainedVariant
        For the others, in their order.
    """
    return StudyTables(
        scores=score_rows(variants),
        hyperparameters=tuple(row for variant in variants for row in hyperparameter_rows(variant)),
        datasets=tuple(row for dataset in datasets for row in dataset_rows(dataset)),
    )


def score_rows(variants: Sequence[TrainedVariant]) -> tuple[ScoreRow, ...]:
    """Return Tables 2 to 6, one after the other."""
    rows = [_score_row(trained, score) for trained in variants for score in trained.scores]
    return tuple(sorted(rows, key=lambda row: row.table))  # sorting keeps the order within each


def _score_row(trained: TrainedVariant, score: Score) -> ScoreRow:
    variant, line, own = trained.variant, score.evaluation, score.score
    paper = published_scores().get((variant.name, line.paper_dataset, line.paper_features))
    full_scale = 100.0 if variant.unit == "%" else 1.0  # p_norm is tabulated in percent
    r2 = None if own is None or math.isnan(own.r2_percent) else own.r2_percent
    rmse = None if own is None else full_scale * own.rmse
    return ScoreRow(
        table=line.table,
        variant=variant.name,
        variant_title=variant.title,
        trained_on=variant.dataset,
        n_train=trained.model.n_observations,
        dataset=line.paper_dataset,
        role=line.role,
        features=line.paper_features,
        n=0 if own is None else own.n,
        unit=variant.unit,
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


def hyperparameter_rows(trained: TrainedVariant) -> tuple[HyperparameterRow, ...]:
    """Return a variant's lines of Table 8, the noise variance last.

    Length scales of rational quadratic kernels are GPy's, ℓ √α, as in the paper.
    """
    model, variant = trained.model, trained.variant
    *parameters, noise_variance = model.hyperparameters()
    alpha = next((each.value for each in parameters if each.quantity == "alpha"), None)
    rows = [
        _hyperparameter_row(variant.name, each, model, alpha)
        for each in parameters
        if each.remark != "fixed"
    ]
    target = "ms" if variant.unit == "ms" else ""
    noise = HyperparameterRow(
        variant=variant.name,
        parameter="noise_variance",
        symbol=_SYMBOLS["noise_variance"],
        input="",
        unit=f"{target}²" if target else "",
        value=noise_variance.value,
        paper_value=published_hyperparameters().get((variant.name, "noise_variance", "")),
        at_bound=noise_variance.remark == "at limit",
    )
    return (*rows, noise)


def _hyperparameter_row(
    variant: str, own: Hyperparameter, model: GaussianProcessModel, alpha: float | None
) -> HyperparameterRow:
    quantity = own.quantity
    target = "ms" if model.target == "exposure_ms" else ""
    name, unit, value = "", "", own.value
    if quantity in {"length_scale", "slope_variance"}:
        name = own.inputs[0] if len(own.inputs) == 1 else "all"
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
        variant=variant,
        parameter=quantity,
        symbol=_SYMBOLS[quantity],
        input=name,
        unit=unit,
        value=value,
        paper_value=published_hyperparameters().get((variant, quantity, name)),
        at_bound=own.remark == "at limit",
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


RANGES = ("p_norm", "i_avg", "exposure_ms", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg")
"""Columns of which Table 9 prints the range; r is 0 throughout."""


@dataclass(frozen=True, kw_only=True)
class PublishedScore:
    """A line of Tables 2 to 6.

    Parameters
    ----------
    table : int
        Its number.
    variant, dataset, features : str
        As the paper names kernel, evaluation dataset and features, written plainly.
    r2_percent, mse, rmse : float
        MSE in squared units of the target; RMSE in percent of full scale, or in ms.
    """

    table: int
    variant: str
    dataset: str
    features: str
    r2_percent: float
    mse: float
    rmse: float


@dataclass(frozen=True, kw_only=True)
class PublishedDataset:
    """A line of Table 9.

    Parameters
    ----------
    dataset, features : str
        As the paper names them, written plainly.
    n, n_train : int or None
        Observations, and those trained on, where it says.
    ranges : dict of str to (float, float)
        Least and greatest value of each of `RANGES` that is printed.
    """

    dataset: str
    features: str
    n: int
    n_train: int | None
    ranges: dict[str, tuple[float, float]]


@cache
def published_scores() -> dict[tuple[str, str, str], PublishedScore]:
    """Return Tables 2 to 6 by variant, dataset and features."""
    return {
        (row["model"], row["dataset"], row["features"]): PublishedScore(
            table=int(row["table"]),
            variant=row["model"],
            dataset=row["dataset"],
            features=row["features"],
            r2_percent=float(row["r2_percent"]),
            mse=float(row["mse"]),
            rmse=float(row["rmse"]),
        )
        for row in _rows("scores.csv")
    }


@cache
def published_hyperparameters() -> dict[tuple[str, str, str], float]:
    """Return Table 8: values by variant, hyperparameter and input.

    Hyperparameters are ``variance``, ``length_scale``, ``alpha``, ``slope_variance`` and
    ``noise_variance``; the input is empty where it belongs to none, and ``all`` for the one length
    scale of a kernel without ARD. Length scales are in GPy's convention.
    """
    return {
        (row["variant"], row["parameter"], row["input"]): float(row["value"])
        for row in _rows("hyperparameters.csv")
    }


@cache
def published_datasets() -> dict[str, PublishedDataset]:
    """Return Table 9 by dataset."""
    return {
        row["dataset"]: PublishedDataset(
            dataset=row["dataset"],
            features=row["features"],
            n=int(row["n"]),
            n_train=int(row["n_train"]) if row["n_train"] else None,
            ranges={
                name: (float(row[f"{name}_low"]), float(row[f"{name}_high"]))
                for name in RANGES
                if row[f"{name}_low"]
            },
        )
        for row in _rows("datasets.csv")
    }


def _rows(name: str) -> Iterator[dict[str, str]]:
    text = files("exposight.paper").joinpath("data", name).read_text(encoding="utf-8")
    yield from csv.DictReader(text.splitlines())
