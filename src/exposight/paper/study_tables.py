"""Tables 2, 3, 4, 5, 6, 8 and 9 of the paper: ours, the paper's, and the difference.

The paper's figures are data of the package: facts, copied from its tables. ``data/scores.csv``
holds Tables 2 to 6, ``data/hyperparameters.csv`` Table 8 (a product's variances multiplied, since
only that matters), ``data/datasets.csv`` Table 9.
"""

import csv
import math
import operator
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from functools import cache
from importlib.resources import files
from typing import Final

import numpy as np
import polars as pl

from exposight.files import csv_of
from exposight.gp import gpy_length_scale
from exposight.models import Hyperparameter
from exposight.observing import ObservationTable
from exposight.paper.datasets import Dataset
from exposight.paper.results import Score, StudyResult, StudyTables, TrainedVariant
from exposight.paper.variants import Variant

RANGES: Final = ("p_norm", "i_avg", "exposure_ms", "x_mm", "y_mm", "z_mm", "w_deg", "p_deg")
"""Columns of which Table 9 prints the range; r is 0 throughout."""

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


@cache
def published_scores() -> dict[tuple[str, str, str], dict[str, float]]:
    """Return Tables 2 to 6 by variant, dataset and features, written plainly.

    Each line has ``table``, ``r2_percent``, ``mse`` in squared units of the target, and ``rmse`` in
    percent of full scale, or in ms.
    """
    return {
        (row["variant"], row["dataset"], row["features"]): {
            name: float(row[name]) for name in ("table", "r2_percent", "mse", "rmse")
        }
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
def published_datasets() -> dict[str, dict[str, str]]:
    """Return Table 9's lines by dataset; cells are empty where the paper prints nothing."""
    return {row["dataset"]: row for row in _rows("datasets.csv")}


def _rows(name: str) -> Iterator[dict[str, str]]:
    text = files("exposight.paper").joinpath("data", name).read_text(encoding="utf-8")
    yield from csv.DictReader(text.splitlines())


def study_tables(datasets: Iterable[Dataset], variants: Iterable[TrainedVariant]) -> StudyTables:
    """Return all tables.

    Parameters
    ----------
    datasets : iterable of Dataset
        For Table 9, in its order.
    variants : iterable of TrainedVariant
        For the others, in their order.
    """
    variants = tuple(variants)
    return StudyTables(
        scores=score_table(variants),
        hyperparameters=hyperparameter_table(variants),
        datasets=dataset_table(datasets),
    )


def table_files(result: StudyResult) -> dict[str, bytes]:
    """Return the study's tables and findings as CSV files with a header, by the files' names.

    Numbers are written so that reading them gives the same ones; null is empty.
    """
    scores = result.tables.scores
    numbers = scores["table"].unique().sort() if len(scores) else ()
    frames = {f"table-{number}": scores.filter(pl.col("table") == number) for number in numbers}
    frames["table-8"] = result.tables.hyperparameters
    frames["table-9"] = result.tables.datasets
    frames["findings"] = _frame(map(asdict, result.findings))
    return {f"{name}.csv": csv_of(frame) for name, frame in frames.items()}


def _frame(rows: Iterable[Mapping[str, object]]) -> pl.DataFrame:
    return pl.DataFrame(list(rows), infer_schema_length=None)


def score_table(variants: Iterable[TrainedVariant]) -> pl.DataFrame:
    """Return Tables 2 to 6, one after the other (`StudyTables`)."""
    rows = [
        score_row(trained.variant, trained.model.n_observations, score)
        for trained in variants
        for score in trained.scores
    ]
    return _frame(sorted(rows, key=operator.itemgetter("table")))  # keeps their order


def score_row(variant: Variant, n_train: int, line: Score) -> dict[str, object]:
    """Return one line of Tables 2 to 6 (`StudyTables`), of a variant trained on so many rows."""
    rows, score = line.evaluation, line.score
    paper = published_scores().get((variant.name, rows.paper_dataset, rows.paper_features), {})
    full_scale = 100.0 if variant.unit == "%" else 1.0  # p_norm is tabulated in percent
    r2 = None if score is None or math.isnan(score.r2_percent) else score.r2_percent
    rmse = None if score is None else full_scale * score.rmse
    return {
        "table": rows.table,
        "variant": variant.name,
        "variant_title": variant.title,
        "trained_on": variant.dataset,
        "n_train": n_train,
        "dataset": rows.paper_dataset,
        "role": rows.role,
        "features": rows.paper_features,
        "n": 0 if score is None else score.n,
        "unit": variant.unit,
        "r2_percent": r2,
        "mse": None if score is None else score.mse,
        "rmse": rmse,
        "mae": None if score is None else full_scale * score.mae,
        "relative_error_percent": line.relative_error_percent,
        "coverage_1sigma_percent": _percent(score.coverage_1sigma if score else None),
        "coverage_2sigma_percent": _percent(score.coverage_2sigma if score else None),
        **{f"paper_{name}": paper.get(name) for name in ("r2_percent", "mse", "rmse")},
        "r2_difference": r2 - paper["r2_percent"] if paper and r2 is not None else None,
        "rmse_difference": rmse - paper["rmse"] if paper and rmse is not None else None,
    }


def _percent(share: float | None) -> float | None:
    return None if share is None else 100.0 * share


def hyperparameter_table(variants: Iterable[TrainedVariant]) -> pl.DataFrame:
    """Return Table 8 (`StudyTables`): of each variant the noise variance last."""
    return _frame(row for trained in variants for row in _hyperparameter_rows(trained))


def _hyperparameter_rows(trained: TrainedVariant) -> Iterator[dict[str, object]]:
    variant, model = trained.variant.name, trained.model
    items = model.hyperparameters()
    alpha = next((item.value for item in items if item.quantity == "alpha"), None)
    squared = "ms²" if model.target == "exposure_ms" else ""
    for item in items:
        if item.remark == "fixed":
            continue
        column, unit = _input_and_unit(item, squared)
        parameter = item.name if item.name == "noise_variance" else item.quantity
        value = item.value
        if item.quantity == "length_scale" and alpha is not None:
            value = gpy_length_scale(value, alpha=alpha)
        yield {
            "variant": variant,
            "parameter": parameter,
            "symbol": _SYMBOLS[parameter],
            "input": column,
            "unit": unit,
            "value": value,
            "paper_value": published_hyperparameters().get((variant, parameter, column)),
            "at_bound": item.remark == "at limit",
        }


def _input_and_unit(item: Hyperparameter, squared: str) -> tuple[str, str]:
    """Return the column that a hyperparameter belongs to, if any, and its unit."""
    if item.quantity not in {"length_scale", "slope_variance"}:
        return "", "" if item.quantity == "alpha" else squared
    if len(item.inputs) > 1:  # one length scale serves mm, degrees and grey levels at once
        return "all", "mixed"
    (column,) = item.inputs
    unit = _UNITS[column.rsplit("_", 1)[1]]
    if item.quantity == "slope_variance":
        unit = f"(ms/{unit})²" if unit else "ms²"
    return column, unit


def dataset_table(datasets: Iterable[Dataset]) -> pl.DataFrame:
    """Return Table 9 (`StudyTables`): of X its three depth planes, then all of it."""
    return _frame(row for dataset in datasets for row in _dataset_rows(dataset))


def _dataset_rows(dataset: Dataset) -> Iterator[dict[str, object]]:
    if dataset.name == "X":
        z_mm = dataset.table.array(["z_mm"])[:, 0]
        for plane, low, high in _PLANES:
            rows = dataset.table.where((z_mm >= low) & (z_mm < high))
            yield _dataset_row(dataset, f"X {plane}", rows)
    sides = {"n_train": dataset.train, "n_validation": dataset.validation}
    counts = {name: None if side is None else len(side) for name, side in sides.items()}
    yield _dataset_row(dataset, dataset.name, dataset.table) | counts


def _dataset_row(dataset: Dataset, name: str, table: ObservationTable) -> dict[str, object]:
    paper = published_datasets()[name]
    return {
        "dataset": name,
        "sensor": dataset.sensor,
        "features": paper["features"],
        "n": len(table),
        "n_train": None,
        "n_validation": None,
        "n_features": len(set(table.names("feature"))),
        "n_views": len(set(table.names("view"))),
        **{f"{column}_{end}": value for column in RANGES for end, value in _range(table, column)},
        "paper_n": int(paper["n"]),
        "paper_n_train": int(paper["n_train"]) if paper["n_train"] else None,
        **{
            f"paper_{column}_{end}": float(text) if (text := paper[f"{column}_{end}"]) else None
            for column in RANGES
            for end in ("low", "high")
        },
    }


def _range(table: ObservationTable, column: str) -> Iterator[tuple[str, float | None]]:
    values = table.array([column])
    yield "low", float(np.min(values)) if len(values) else None
    yield "high", float(np.max(values)) if len(values) else None
